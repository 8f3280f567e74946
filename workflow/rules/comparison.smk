# The papers beside each other: one job per comparison, from the artifacts of the default reading.


rule comparison:
    input:
        compared(),


rule comparison_product:
    input:
        lambda wildcards: [path for files in compared_artifacts(wildcards).values() for path in files.values()],
    output:
        png=comparison_shown("figure", "png"),
        pdf="figures/comparison/{stem}.pdf",
        csv=comparison_shown("table", "csv"),
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
        **reached("comparison.py", comparison_entries),
        inputs=comparison_inputs,
        artifacts=compared_artifacts,
        captions=comparison_captions,
    script:
        "../scripts/comparison.py"
