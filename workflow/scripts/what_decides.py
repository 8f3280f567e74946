"""Judge a paper's claims by its universes, and draw what decides them."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.plotting.style import save_figure
from marsedl.plotting.universes import pictures
from marsedl.replication.claims.rows import read_claims
from marsedl.replication.files import write_json
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table
from marsedl.replication.universes.judging import judge_of
from marsedl.replication.universes.tabulating import claims_table, effects_table

with guarded(snakemake) as job:
    project, rows = Path(snakemake.params.project).resolve(), read_claims(snakemake.input.claims)
    given = project, job.made["size"], job.made["own"], snakemake.input.table, rows
    judge = judge_of(catalogue(job.paper), input_model(job.paper), *given)
    write_json({name: judge.standing(name) for name in judge.column}, snakemake.output.standings)
    write_table(claims_table(judge), *snakemake.output.judged)
    write_table(effects_table(judge), *snakemake.output.effects)
    for picture, path in zip(pictures(judge), snakemake.output.pictures, strict=True):
        save_figure(picture, path)
