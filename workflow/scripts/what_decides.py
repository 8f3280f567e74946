"""Judge a paper's claims by its universes, and draw what decides them."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.plotting.style import save_figure
from marsedl.plotting.universes import pictures
from marsedl.replication.claims.rows import read_claims, write_as
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table
from marsedl.replication.universes.deciding import Decided, claims_table, decided, effects_table
from marsedl.replication.universes.judging import judge_of
from marsedl.replication.universes.waves import Matching

with guarded(snakemake) as job:
    project, rows, paper = Path(snakemake.params.project).resolve(), read_claims(snakemake.input.claims), job.paper
    given = project, job.params["size"], job.params["own"], snakemake.input.table, rows
    judge = judge_of(catalogue(paper), input_model(paper), *given)
    matching = Matching(judge)
    found = decided(rows, catalogue(paper).errata, judge, matching)
    write_as(Decided, found, snakemake.output.decided)
    write_table(claims_table(judge), *snakemake.output.judged)
    write_table(effects_table(judge), *snakemake.output.effects)
    for picture, path in zip(pictures(judge, matching), snakemake.output.pictures, strict=True):
        save_figure(picture, path)
