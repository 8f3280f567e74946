# Figures and tables: one job for each figure, and one for the tables of a reading that need the same artifacts. Those of
# the default reading stand right under figures/<paper>, of any other in its folder.
FIGURE, TABLES = ("figure", ("png", "pdf")), ("table", ("csv", "md"))


def product_rules():
    """Name and kind of each rule, its paper and the names of its products; those of all figures are wildcards."""
    yield "figure", FIGURE, "{paper}", ["{stem}"]
    for paper, catalogue in PAPERS.items():
        for tables in command_line.tables_of_equal_needs(catalogue):
            yield f"{paper}_table_{next(iter(tables))}", TABLES, paper, list(tables)


def reading_of(wildcards):
    """The reading in whose folder a product stands."""
    return wildcards.place.strip("/") or DEFAULT


def product_files(kind, paper, stems):
    """Files of a rule's products, of which the first of each is shown by `snakemake --report`."""

    def labels_of(stem):
        return lambda wildcards: {"reading": reading_of(wildcards), "item": filled(stem, wildcards), "kind": kind[0]}

    for stem in stems:
        shown, other = (f"figures/{paper}/{{place}}{stem}.{suffix}" for suffix in kind[1])
        place = dict(category=paper, subcategory=reading_of, labels=labels_of(stem))
        yield report(shown, caption=f"../report/{kind[0]}.rst", **place)
        yield other


def product_functions(kind, paper, stems):
    """The input function of a rule of products and its params."""

    def products(wildcards):
        return {stem: PAPERS[filled(paper, wildcards)].product(stem) for stem in (filled(s, wildcards) for s in stems)}

    def artifacts(wildcards):
        product = next(iter(products(wildcards).values()))
        return files(filled(paper, wildcards), reading_of(wildcards), product.needs, product.optional)

    def entries(wildcards):
        return [f"marsedl.papers.{filled(paper, wildcards)}.{kind[0]}s:{stem}" for stem in products(wildcards)]

    def inputs(wildcards):
        names = {name for product in products(wildcards).values() for name in product.inputs}
        return given(filled(paper, wildcards), reading_of(wildcards), names)

    def published(wildcards):
        return filled(f"data/published/{paper}.yaml", wildcards)

    def printed(wildcards):
        shown = any(product.published for product in products(wildcards).values())
        return file_digest(published(wildcards)) if shown else ""

    def captions(wildcards, output):
        return {stem: as_rst(product.caption) for stem, product in products(wildcards).items()}

    return artifacts, dict(
        paper=lambda wildcards: filled(paper, wildcards),
        reading=reading_of,
        stems=lambda wildcards: list(products(wildcards)),
        inputs=inputs,
        published=lambda wildcards: source(published(wildcards)),
        printed=printed,
        captions=captions,
        **reached(f"{kind[0]}s.py", entries),
    )


for _name, _kind, _paper, _stems in product_rules():
    _input, _params = product_functions(_kind, _paper, _stems)

    rule:
        name:
            _name
        input:
            unpack(_input),
        output:
            list(product_files(_kind, _paper, _stems)),
        log:
            f"logs/{_paper}/{{place}}{_stems[0]}.log",
        benchmark:
            f"benchmarks/{_paper}/{{place}}{_stems[0]}.tsv"
        wildcard_constraints:
            stem="|".join(stem for paper in PAPERS.values() for stem in paper.figures),
        conda:
            "../envs/marsedl.yaml"
        params:
            **_params,
        script:
            f"../scripts/{_kind[0]}s.py"
