# Digests of all products, and the page that shows them.


rule report:
    input:
        "report/index.html",


rule digests:
    input:
        [products(paper) + cache(paper) for paper in PAPERS],
        "report/claims.json",
    output:
        "report/digests.json",
    log:
        "logs/digests.log",
    conda:
        "../envs/marsedl.yaml"
    params:
        code=script_of("digests.py"),
    script:
        "../scripts/digests.py"


rule index:
    input:
        [path for paper in PAPERS for path in products(paper)],
        claims="report/claims.json",
        digests="report/digests.json",
    output:
        "report/index.html",
    log:
        "logs/report.log",
    conda:
        "../envs/marsedl.yaml"
    params:
        readings={paper: described(paper) for paper in PAPERS},
        size=str(config.get("size", "full")),
        benchmarks="data/reference/benchmarks.csv",
        benchmark_digest=file_digest("data/reference/benchmarks.csv"),
        template=file_digest("src/marsedl/replication/templates/report.html.j2"),
        code=script_of("report.py"),
        catalogues={
            paper: DIGESTS.code(f"marsedl.papers.{paper}:PAPER") for paper in PAPERS
        },
    script:
        "../scripts/report.py"
