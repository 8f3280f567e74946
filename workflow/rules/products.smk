# Figures and tables: one job for each figure, and one for the tables of a reading that need the same artifacts. Those of
# the default reading stand right under figures/<paper>, of any other in its folder.


def reading_of(wildcards):
    """The reading in whose folder a product stands."""
    return wildcards.place.strip("/") or DEFAULT


def shown_in_report(path, paper, kind, stem):
    """Mark a product for `snakemake --report`: under its paper, found by reading and item."""
    return report(
        path,
        caption=f"../report/{kind}.rst",
        category=paper,
        subcategory=reading_of,
        labels=lambda wildcards: {
            "reading": reading_of(wildcards),
            "item": stem or wildcards.stem,
            "kind": kind,
        },
    )


def product_input(paper_of, items):
    """Input files of a job that makes products; items: a function of the wildcards, to the products by name."""

    def named(wildcards):
        item = next(iter(items(wildcards).values()))
        return files(
            paper_of(wildcards), reading_of(wildcards), item.needs, item.optional
        )

    return named


def product_params(kind, script, paper_of, items):
    """The params of a rule that makes products."""

    def entries(wildcards):
        paper = paper_of(wildcards)
        return [f"marsedl.papers.{paper}.{kind}:{stem}" for stem in items(wildcards)]

    def inputs(wildcards):
        names = {name for item in items(wildcards).values() for name in item.inputs}
        return given(paper_of(wildcards), reading_of(wildcards), names)

    def printed(wildcards):
        shown = any(item.published for item in items(wildcards).values())
        path = f"data/published/{paper_of(wildcards)}.yaml"
        return file_digest(path) if shown else ""

    return dict(
        paper=paper_of,
        reading=reading_of,
        stems=lambda wildcards: list(items(wildcards)),
        inputs=inputs,
        code=lambda wildcards: code(script, *entries(wildcards)),
        libraries=lambda wildcards: libraries(script, *entries(wildcards)),
        build=build,
        published=lambda wildcards: source(
            f"data/published/{paper_of(wildcards)}.yaml"
        ),
        printed=printed,
        captions=lambda wildcards, output: {
            stem: as_rst(item.caption) for stem, item in items(wildcards).items()
        },
    )


def figure_of(wildcards):
    """The figure that a job draws, by its name."""
    return {wildcards.stem: PAPERS[wildcards.paper].figures[wildcards.stem]}


rule figure:
    input:
        unpack(product_input(lambda wildcards: wildcards.paper, figure_of)),
    output:
        png=shown_in_report(
            "figures/{paper}/{place}{stem}.png", "{paper}", "figure", ""
        ),
        pdf="figures/{paper}/{place}{stem}.pdf",
    log:
        "logs/{paper}/{place}{stem}.log",
    benchmark:
        "benchmarks/{paper}/{place}{stem}.tsv"
    wildcard_constraints:
        stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
    conda:
        "../envs/marsedl.yaml"
    params:
        **product_params(
            "figures", "figure.py", lambda wildcards: wildcards.paper, figure_of
        ),
    script:
        "../scripts/figure.py"


for _paper in PAPERS:
    for _group in command_line.tables_of_equal_needs(PAPERS[_paper]):

        rule:
            name:
                f"{_paper}_table_{next(iter(_group))}"
            input:
                unpack(
                    product_input(
                        lambda wildcards, paper=_paper: paper,
                        lambda wildcards, group=_group: group,
                    )
                ),
            output:
                **{
                    stem: [
                        shown_in_report(
                            f"figures/{_paper}/{{place}}{stem}.csv",
                            _paper,
                            "table",
                            stem,
                        ),
                        f"figures/{_paper}/{{place}}{stem}.md",
                    ]
                    for stem in _group
                },
            log:
                f"logs/{_paper}/{{place}}{next(iter(_group))}.log",
            benchmark:
                f"benchmarks/{_paper}/{{place}}{next(iter(_group))}.tsv"
            conda:
                "../envs/marsedl.yaml"
            params:
                **product_params(
                    "tables",
                    "tables.py",
                    lambda wildcards, paper=_paper: paper,
                    lambda wildcards, group=_group: group,
                ),
            script:
                "../scripts/tables.py"
