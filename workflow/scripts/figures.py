"""Draw one figure."""

from marsedl.plotting.style import save_figure
from marsedl.replication.claims.printed import published_by_id
from marsedl.replication.pipeline.catalogue import entry_of, function_of
from marsedl.replication.pipeline.jobs import guarded

with guarded(snakemake) as job:
    function = function_of(entry_of(job.paper, "figures", snakemake.wildcards.stem))
    published = published_by_id(snakemake.input.published) if job.params["printed"] else None
    save_figure(job.given().call(function, published=published), *snakemake.output)
