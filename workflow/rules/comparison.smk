# The papers beside each other: one job per comparison, from the artifacts of the default reading.


def compared_artifacts(stem):
    """Artifacts of a comparison by paper, by parameter."""
    return {
        paper: files(paper, DEFAULT, taken.needs, taken.optional)
        for paper, taken in COMPARISONS[stem].takes.items()
    }


def comparison_entries(stem):
    """The functions of a comparison."""
    names = ("figure", "table", *COMPARISONS[stem].papers)
    return [f"marsedl.comparison.{stem}:{name}" for name in names]


def comparison_inputs(wildcards):
    """Inputs that a comparison reads, by paper."""
    takes = COMPARISONS[wildcards.stem].takes
    return {
        paper: given(paper, DEFAULT, taken.inputs) for paper, taken in takes.items()
    }


def comparison_captions(wildcards, output):
    """Captions of the figure and the table of a comparison."""
    written = COMPARISONS[wildcards.stem]
    return {"figure": as_rst(written.figure), "table": as_rst(written.table)}


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
            caption="../report/comparison_figure.rst",
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
        inputs=comparison_inputs,
        artifacts=lambda wildcards: compared_artifacts(wildcards.stem),
        code=lambda wildcards: code(
            "comparison.py", *comparison_entries(wildcards.stem)
        ),
        libraries=lambda wildcards: libraries(
            "comparison.py", *comparison_entries(wildcards.stem)
        ),
        build=build,
        benchmarks=source("data/reference/benchmarks.csv"),
        measured=lambda wildcards: (
            file_digest("data/reference/benchmarks.csv")
            if COMPARISONS[wildcards.stem].measured
            else ""
        ),
        captions=comparison_captions,
    script:
        "../scripts/comparison.py"
