# Digests of all products, and the page that shows them.


CLOSEUPS = [f"marsedl.papers.{paper}.closeups:{name}" for paper in PAPERS for name in PAPERS[paper].closeups]


rule report:
    input:
        "report/index.html",


rule digests:
    input:
        [products(paper) + cache(paper) for paper in PAPERS],
        compared(),
        "report/claims.json",
    output:
        "report/digests.json",
    log:
        "logs/digests.log",
    benchmark:
        "benchmarks/digests.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        code=code("digests.py"),
        build=build,
    script:
        "../scripts/digests.py"


rule index:
    input:
        [products(paper) + cache(paper) for paper in PAPERS],
        compared(),
        claims="report/claims.json",
        digests="report/digests.json",
    output:
        "report/index.html",
    log:
        "logs/report.log",
    benchmark:
        "benchmarks/report.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        readings={paper: described(paper) for paper in PAPERS},
        size=SIZE,
        benchmarks=source(BENCHMARKS),
        benchmark_digest=file_digest(BENCHMARKS),
        machines=source("data/reference/machines.csv"),
        machines_digest=file_digest("data/reference/machines.csv"),
        artifacts={paper: {reading: claimed(paper, reading) for reading in STUDIES[paper].compared} for paper in PAPERS},
        templates=[file_digest(f"src/marsedl/replication/templates/report.{part}") for part in ("html.j2", "css", "js")],
        code=code("report.py"),
        libraries=libraries("report.py", *CLOSEUPS),
        build=build,
        closeups=[DIGESTS.code(entry) for entry in CLOSEUPS],
        catalogues={paper: DIGESTS.code(f"marsedl.papers.{paper}:PAPER") for paper in PAPERS},
        comparisons=DIGESTS.code("marsedl.comparison:COMPARISONS"),
    script:
        "../scripts/report.py"
