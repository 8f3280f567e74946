# The papers beside each other: one job per comparison, from the artifacts of the default reading.


rule comparison:
    input:
        compared(),


rule comparison_product:
    input:
        lambda wildcards: RECIPES.job(f"figures/comparison/{wildcards.stem}.png").needs,
        changed=unproven("figures/comparison/{stem}.png"),
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
        made=made("figures/comparison/{stem}.png"),
        artifacts=lambda wildcards: RECIPES.compared_artifacts(wildcards.stem),
        captions=comparison_captions,
        build=build,
    script:
        "../scripts/comparison.py"
