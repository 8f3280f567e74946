"""Join the universes of a paper, judge its claims by them, and draw what decides them."""

from pathlib import Path

from marsedl.papers import catalogue, input_model
from marsedl.plotting.style import save_figure
from marsedl.plotting.universes import pictures
from marsedl.replication.pipeline.jobs import guarded
from marsedl.replication.records import store
from marsedl.replication.records.tables import write_table
from marsedl.replication.universes.judging import Judge
from marsedl.replication.universes.table import Evaluator, Universes, gathered
from marsedl.replication.universes.tabulating import claims_table, effects_table

with guarded(snakemake) as job:
    output = snakemake.output
    project = Path(snakemake.params.project).resolve()
    evaluator = Evaluator.of(catalogue(job.paper), input_model(job.paper), project, job.made["size"])
    table = gathered([store.load(path, Universes, paper=job.paper) for path in snakemake.input.chunks])
    judge = Judge(table, evaluator.study.choices, list(evaluator.published.values()))
    write_table(claims_table(judge), *output.judged)
    write_table(effects_table(judge), *output.effects)
    for picture, path in zip(pictures(judge), output.pictures, strict=False):
        save_figure(picture, path)
    store.save(output.table, table, paper=job.paper, reading="universes", provenance={"size": job.made["size"]})
