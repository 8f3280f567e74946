# Figures and tables: one job for each figure, one for the tables of a reading that need the same artifacts or some of
# them, and one for each comparison of the papers. Those of the default reading stand right under figures/<paper>, others
# in its folder.


# All of the papers but what decides their claims: the universes take more than half of the time of `all`.
rule papers:
    input:
        [product for paper in PAPERS for product in PRODUCTS.shown(paper)],


rule figure:
    input:
        artifacts=artifacts_of("figures/{paper}/{place}{stem}.png"),
        published=source("data/published/{paper}.yaml"),
        rerun=if_stale("figures/{paper}/{place}{stem}.png"),
    output:
        report("figures/{paper}/{place}{stem}.png", category="{paper}"),
        "figures/{paper}/{place}{stem}.pdf",
    log:
        "logs/{paper}/{place}{stem}.log",
    benchmark:
        "benchmarks/{paper}/{place}{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    priority: 2 * SHOWN
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("figures/{paper}/{place}{stem}.png"),
    script:
        "../scripts/figures.py"


# A rule for each set of tables: the files of a job are as many as its tables. A job for each table would start fourteen
# processes more, and each takes longer to start than to write a table.
for _paper, _tables in [(slug, tables) for slug in PAPERS for tables in PAPERS[slug].tables_by_job()]:

    rule:
        name:
            f"{_paper}_table_{_tables[0]}"
        input:
            artifacts=artifacts_of(f"figures/{{paper}}/{{place}}{_tables[0]}.csv"),
            published=source("data/published/{paper}.yaml"),
            rerun=if_stale(f"figures/{{paper}}/{{place}}{_tables[0]}.csv"),
        output:
            csv=[report(f"figures/{{paper}}/{{place}}{stem}.csv", category="{paper}") for stem in _tables],
            md=[f"figures/{{paper}}/{{place}}{stem}.md" for stem in _tables],
        log:
            f"logs/{{paper}}/{{place}}{_tables[0]}.log",
        benchmark:
            f"benchmarks/{{paper}}/{{place}}{_tables[0]}.tsv"
        wildcard_constraints:
            paper=_paper,
        conda:
            "../envs/marsedl.yaml"
        params:
            given=params_of(f"figures/{{paper}}/{{place}}{_tables[0]}.csv"),
        script:
            "../scripts/tables.py"


rule compared:
    input:
        artifacts=artifacts_of("figures/comparison/{stem}.png"),
        rerun=if_stale("figures/comparison/{stem}.png"),
    output:
        png=report("figures/comparison/{stem}.png", category="comparison"),
        pdf="figures/comparison/{stem}.pdf",
        csv=report("figures/comparison/{stem}.csv", category="comparison"),
        md="figures/comparison/{stem}.md",
    log:
        "logs/comparison/{stem}.log",
    benchmark:
        "benchmarks/comparison/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(COMPARISONS),
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("figures/comparison/{stem}.png"),
    script:
        "../scripts/comparison.py"
