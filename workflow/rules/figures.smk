# One job per figure and table. Those of the default reading stand right under figures/<paper>.


rule figure:
    input:
        unpack(
            lambda wildcards: drawn_from(
                wildcards.paper, wildcards.stem, wildcards.reading
            )
        ),
    output:
        png="figures/{paper}/{reading}/{stem}.png",
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
    script:
        "../scripts/figure.py"


use rule figure as default_figure with:
    input:
        unpack(lambda wildcards: drawn_from(wildcards.paper, wildcards.stem, DEFAULT)),
    output:
        png="figures/{paper}/{stem}.png",
        pdf="figures/{paper}/{stem}.pdf",
    log:
        "logs/{paper}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    params:
        **product("figures", "figure.py", DEFAULT),


rule table:
    input:
        unpack(
            lambda wildcards: drawn_from(
                wildcards.paper, wildcards.stem, wildcards.reading
            )
        ),
    output:
        csv="figures/{paper}/{reading}/{stem}.csv",
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
    script:
        "../scripts/table.py"


use rule table as default_table with:
    input:
        unpack(lambda wildcards: drawn_from(wildcards.paper, wildcards.stem, DEFAULT)),
    output:
        csv="figures/{paper}/{stem}.csv",
        md="figures/{paper}/{stem}.md",
    log:
        "logs/{paper}/{stem}.log",
    benchmark:
        "benchmarks/{paper}/{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.tables),
    params:
        **product("tables", "table.py", DEFAULT),
