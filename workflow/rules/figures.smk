# One job per figure and table. Those of the default reading stand right under figures/<paper>.


rule figure:
    input:
        unpack(
            lambda wildcards: drawn_from(
                wildcards.paper, wildcards.stem, wildcards.reading
            )
        ),
    output:
        png=shown_in_report("figures/{paper}/{reading}/{stem}.png", "figure"),
        pdf="figures/{paper}/{reading}/{stem}.pdf",
    log:
        "logs/{paper}/{reading}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{reading}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    conda:
        "../envs/marsedl.yaml"
    params:
        **product("figures", "figure.py"),
        caption=caption_of_product,
    script:
        "../scripts/figure.py"


use rule figure as default_figure with:
    input:
        unpack(lambda wildcards: drawn_from(wildcards.paper, wildcards.stem, DEFAULT)),
    output:
        png=shown_in_report("figures/{paper}/{stem}.png", "figure", DEFAULT),
        pdf="figures/{paper}/{stem}.pdf",
    log:
        "logs/{paper}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    params:
        **product("figures", "figure.py", DEFAULT),
        caption=caption_of_product,


rule table:
    input:
        unpack(
            lambda wildcards: drawn_from(
                wildcards.paper, wildcards.stem, wildcards.reading
            )
        ),
    output:
        csv=shown_in_report("figures/{paper}/{reading}/{stem}.csv", "table"),
        md="figures/{paper}/{reading}/{stem}.md",
    log:
        "logs/{paper}/{reading}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{reading}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.tables),
    conda:
        "../envs/marsedl.yaml"
    params:
        **product("tables", "table.py"),
        caption=caption_of_product,
    script:
        "../scripts/table.py"


use rule table as default_table with:
    input:
        unpack(lambda wildcards: drawn_from(wildcards.paper, wildcards.stem, DEFAULT)),
    output:
        csv=shown_in_report("figures/{paper}/{stem}.csv", "table", DEFAULT),
        md="figures/{paper}/{stem}.md",
    log:
        "logs/{paper}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.tables),
    params:
        **product("tables", "table.py", DEFAULT),
        caption=caption_of_product,
