# Figures and tables: one job for each figure, one for the tables of a reading that need the same artifacts, and one for
# each comparison of the papers. Those of the default reading stand right under figures/<paper>, others in its folder.


rule figure:
    input:
        unpack(inputs("figures/{paper}/{place}{stem}.png")),
    output:
        shown("figures/{paper}/{place}{stem}.png", "figure"),
        "figures/{paper}/{place}{stem}.pdf",
    log:
        "logs/{paper}/{place}{stem}.log",
    benchmark:
        "benchmarks/{paper}/{place}{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("figures/{paper}/{place}{stem}.png"),
        captions=captions("{stem}"),
    script:
        "../scripts/figures.py"


# A rule for each set of tables: the files of a job are as many as its tables. A job for each table would start fourteen
# processes more, and each takes longer to start than to write a table.
for _paper, _tables in [(slug, tables) for slug in PAPERS for tables in PAPERS[slug].tables_of_equal_needs()]:

    rule:
        name:
            f"{_paper}_table_{_tables[0]}"
        input:
            unpack(inputs(f"figures/{{paper}}/{{place}}{_tables[0]}.csv")),
        output:
            csv=[shown(f"figures/{{paper}}/{{place}}{stem}.csv", "table", stem) for stem in _tables],
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
            made=made(f"figures/{{paper}}/{{place}}{_tables[0]}.csv"),
            captions=captions(*_tables),
        script:
            "../scripts/tables.py"


rule compared:
    input:
        unpack(inputs("figures/comparison/{stem}.png")),
    output:
        png=shown(
            "figures/comparison/{stem}.png", "figure", category="comparison of the papers", caption="compared_figure"
        ),
        pdf="figures/comparison/{stem}.pdf",
        csv=shown(
            "figures/comparison/{stem}.csv", "table", category="comparison of the papers", caption="compared_table"
        ),
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
        made=made("figures/comparison/{stem}.png"),
        captions=captions(),
    script:
        "../scripts/comparison.py"
