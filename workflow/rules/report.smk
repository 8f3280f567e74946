# Digests of all products, and the pages of the report that show them.


CLOSEUPS = [f"marsedl.papers.{paper}.closeups:{name}" for paper in PAPERS for name in PAPERS[paper].closeups]


TEMPLATES = ROOT / "src" / "marsedl" / "replication" / "templates"
SITE = site_files({**{paper: PAPERS[paper].figures for paper in PAPERS}, "comparison": COMPARISONS})


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


rule site:
    input:
        [products(paper) + cache(paper) for paper in PAPERS],
        compared(),
        claims="report/claims.json",
        digests="report/digests.json",
    output:
        [f"report/{name}" for name in SITE],
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
        templates={path.name: file_digest(path.relative_to(ROOT)) for path in sorted(TEMPLATES.glob("*.*"))},
        code=code("report.py"),
        libraries=libraries("report.py", *CLOSEUPS),
        build=build,
        closeups=[DIGESTS.code(entry) for entry in CLOSEUPS],
        catalogues={paper: DIGESTS.code(f"marsedl.papers.{paper}:PAPER") for paper in PAPERS},
        texts=[
            file_digest(f"src/marsedl/{place}/{TEXTS}") for place in (*(f"papers/{p}" for p in PAPERS), "comparison")
        ],
    script:
        "../scripts/report.py"
