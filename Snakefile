# Regenerates every figure, table and number of the replicated papers. Plain `snakemake all` is right: see
# profiles/default for the settings it uses and README.md for the targets.
import atexit
import sys
from pathlib import Path

from marsedl.replication.errors import MarsedlError
from marsedl.replication.pipeline.numerics import pin_numerics

try:
    pin_numerics(Path(workflow.current_basedir), here=False)  # Snakemake itself imports numpy first
except MarsedlError as error:
    sys.exit(f"\nmarsedl: {error}\n")


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/stages.smk"
include: "workflow/rules/products.smk"
include: "workflow/rules/claims.smk"
include: "workflow/rules/universes.smk"
include: "workflow/rules/arena.smk"
include: "workflow/rules/report.smk"


onstart:
    say_why()
    if SIZE != "full":
        print(f"size {SIZE}: everything is written to build/{SIZE}", file=sys.stderr)
    # For its limit of submissions a second, Snakemake looks for free jobs again a second after every look, so that some
    # hundred finished jobs keep a core busy with looking. Processes of this machine need no such limit.
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


onerror:
    # Words of Snakemake's own follow the message of a failed job, so all of them are said again at the very end.
    from marsedl.replication.pipeline.jobs import failure

    failed = sorted({path for job in workflow.scheduler.failed for path in job.log})
    atexit.register(print, *["", *filter(None, map(failure, map(Path, failed)))], sep="\n", end="", file=sys.stderr)


rule all:
    default_target: True
    input:
        "report/index.html",
        "report/claims.json",
        lambda wildcards: PRODUCTS.job("report/index.html").needs,


rule comparison:
    input:
        PRODUCTS.compared(),


for _paper in PAPERS:

    rule:
        name:
            _paper
        input:
            PRODUCTS.shown(_paper),


# After all rules, whose names a user may ask for. Another workflow that uses this one as a module has words of its own.
try:
    if IS_MAIN:
        check_targets(sys.argv, [rule.name for rule in workflow.rules], PRODUCTS)
except InputError as error:
    sys.exit(f"\nmarsedl: {error}\n")
# What the jobs are planned from is kept for them and for the next plan: now, and with what is read while planning.
PRODUCTS.sources.save()
atexit.register(PRODUCTS.sources.save)
