# The papers beside each other: one job per comparison, from the artifacts of the default reading.


def compared_artifacts(wildcards):
    """Artifacts of a comparison by paper, by parameter."""
    takes = COMPARISONS[wildcards.stem].takes
    return {paper: files(paper, DEFAULT, taken.needs, taken.optional) for paper, taken in takes.items()}


def comparison_entries(wildcards):
    """The functions of a comparison."""
    names = ("figure", "table", *COMPARISONS[wildcards.stem].papers)
    return [f"marsedl.comparison.{wildcards.stem}:{name}" for name in names]


def comparison_inputs(wildcards):
    """Inputs that a comparison reads, by paper."""
    takes = COMPARISONS[wildcards.stem].takes
    return {paper: given(paper, DEFAULT, taken.inputs) for paper, taken in takes.items()}


def comparison_captions(wildcards, output):
    """Captions of the figure and the table of a comparison."""
    written = COMPARISONS[wildcards.stem]
    return {"figure": as_rst(written.figure), "table": as_rst(written.table)}


def comparison_shown(kind, suffix):
    """A file of a comparison, which `snakemake --report` shows."""
    labels = {"reading": DEFAULT, "item": "{stem}", "kind": kind}
    place = dict(category="comparison of the papers", subcategory=DEFAULT, labels=labels)
    return report(f"figures/comparison/{{stem}}.{suffix}", caption=f"../report/comparison_{kind}.rst", **place)


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
        benchmarks=source(BENCHMARKS),
        measured=lambda wildcards: file_digest(BENCHMARKS) if COMPARISONS[wildcards.stem].measured else "",
        captions=comparison_captions,
    script:
        "../scripts/comparison.py"
