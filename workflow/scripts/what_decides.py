"""Judge a paper's claims by its universes, and draw what decides them."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.plotting.style import save_figure
from marsedl.plotting.universes import pictures
from marsedl.replication.files import write_json
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records.tables import write_table
from marsedl.replication.universes.judging import judge_of
from marsedl.replication.universes.tabulating import claims_table, effects_table

with guarded(snakemake) as job:
    paper, given = catalogue(job.paper), (job.made["size"], job.made["own"], snakemake.input.table)
    judge = judge_of(paper, input_model(job.paper), Path(snakemake.params.project).resolve(), *given)
    write_json({str(name): judge.standing(str(name)) for name in judge.table.claim}, snakemake.output.standings)
    write_table(claims_table(judge), *snakemake.output.judged)
    write_table(effects_table(judge), *snakemake.output.effects)
    for picture, path in zip(pictures(judge), snakemake.output.pictures, strict=True):
        save_figure(picture, path)
