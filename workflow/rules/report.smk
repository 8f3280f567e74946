# Digests of all products, and the pages of the report that show them.


SITE = site_files({**{paper: PAPERS[paper].figures for paper in PAPERS}, "comparison": COMPARISONS})


rule report:
    input:
        "report/index.html",


rule digests:
    input:
        RECIPES.job("report/digests.json").needs,
        changed=unproven("report/digests.json"),
    output:
        "report/digests.json",
    log:
        "logs/digests.log",
    benchmark:
        "benchmarks/digests.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/digests.json"),
        build=build,
    script:
        "../scripts/digests.py"


rule site:
    input:
        [products(paper) + cache(paper) for paper in PAPERS],
        compared(),
        claims="report/claims.json",
        digests="report/digests.json",
        changed=unproven("report/index.html"),
    output:
        [f"report/{name}" for name in SITE],
    log:
        "logs/report.log",
    benchmark:
        "benchmarks/report.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/index.html"),
        artifacts={paper: {reading: claimed(paper, reading) for reading in STUDIES[paper].compared} for paper in PAPERS},
        benchmarks=source(BENCHMARKS),
        build=build,
    script:
        "../scripts/report.py"
