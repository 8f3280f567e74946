# The pages that show all products, and the comparison of a build with the committed numbers.


rule report:
    input:
        shown=[PRODUCTS.shown(paper) for paper in PAPERS],
        compared=PRODUCTS.compared(),
        fought=PRODUCTS.fought(),
        artifacts=artifacts_of("report/index.html"),
        claims="report/claims.json",
        universes=expand("report/universes/{paper}.json", paper=PAPERS),
        texts_and_templates=files_of("report/index.html"),
        rerun=if_stale("report/index.html"),
    output:
        [
            f"report/{page}"
            for page in site_files(
                {
                    **{s: [*PAPERS[s].figures, HEADLINE, *UNIVERSE_PICTURES[s]] for s in PAPERS},
                    "comparison": COMPARISONS,
                    "arena": [f"{name}/{stem}" for name, arena in ARENAS.items() for stem in arena.figures],
                }
            )
        ],
    log:
        "logs/report.log",
    benchmark:
        "benchmarks/report.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        # As a function of `output`, which Snakemake does not record: it would, half a megabyte for each of many files.
        given=lambda wildcards, output: params_of("report/index.html")(wildcards),
        project=in_project("."),
        artifacts=lambda wildcards: {
            paper: {name: PRODUCTS.claimed(paper, name) for name in STUDIES[paper].built} for paper in PAPERS
        },
    script:
        "../scripts/report.py"


# The smoke size twice in separate folders, then the full size against the committed numbers.
rule verify:
    input:
        "report/claims.json",
    log:
        "logs/verify.log",
    conda:
        "../envs/marsedl.yaml"
    params:
        python=sys.executable,
    shell:
        "{params.python:q} -m marsedl.cli verify 2> {log}"
