# The papers beside each other: one job per comparison, from the artifacts of the default reading.


rule comparison:
    input:
        compared(),


rule comparison_product:
    input:
        lambda wildcards: [
            path
            for files in compared_artifacts(wildcards.stem).values()
            for path in files.values()
        ],
    output:
        png=report(
            "figures/comparison/{stem}.png",
            caption="../report/figure.rst",
            category="comparison of the papers",
            subcategory=DEFAULT,
            labels={"reading": DEFAULT, "item": "{stem}", "kind": "figure"},
        ),
        pdf="figures/comparison/{stem}.pdf",
        csv=report(
            "figures/comparison/{stem}.csv",
            caption="../report/comparison_table.rst",
            category="comparison of the papers",
            subcategory=DEFAULT,
            labels={"reading": DEFAULT, "item": "{stem}", "kind": "table"},
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
        **comparison_params(),
        caption=caption_of_comparison("figure"),
        table_caption=caption_of_comparison("table"),
    script:
        "../scripts/comparison.py"
