# What the jobs of stages, products and comparisons take and make, as functions of their wildcards.

# --- stages

NAMES = {CHUNK: "chunks/{case}.{chunk}of{chunks}", **dict.fromkeys((FLIGHTS, GATHER), f"{FLIGHTS}.{{case}}")}
# Of logs and benchmarks: those of chunks stand beside the others.
LOGS = NAMES | {CHUNK: f"{FLIGHTS}.{{case}}.{{chunk}}of{{chunks}}"}


def stage_rules(paper):
    """Name, stage and artifacts of each rule of a paper, and the readings that it is for."""
    together = [(cases, "|".join(readings)) for cases, readings in SHARED[paper].flown_together().items()]
    flown = [rf"({readings})/{FLIGHTS}\.({'|'.join(cases)})\.h5" for cases, readings in together]
    others = f"(?!{'|'.join(flown) or '(?!)'})[a-z0-9_]+"
    for number, (cases, readings) in enumerate(together):
        name = f"flights_{number}" if number else "flights"
        yield name, FLIGHTS, [f"{FLIGHTS}.{case}" for case in cases], readings
    for stage in PAPERS[paper].stages:
        yield stage, stage, [NAMES.get(stage, stage)], others if stage == FLIGHTS else "[a-z0-9_]+"


def flown_as(paper, stage):
    """The Monte Carlo cases that are scattered, or the others: whichever a stage flies."""
    return [case for case in MODELS[paper].CASES if (case in SHARED[paper].scattered) == (stage != FLIGHTS)]


def stage_input(paper, stage):
    """Input files of a stage, by the name of its function's parameter."""

    def named(wildcards):
        taken = files(paper, wildcards.reading, PAPERS[paper].stages[stage].needs)
        return taken | (dict(chunks=chunk_files(paper, wildcards)) if stage == GATHER else {})

    return named


def chunk_files(paper, wildcards):
    """The files of all chunks of a Monte Carlo case."""
    chunks = SHARED[paper].chunks(wildcards.reading, wildcards.case)
    return [f"data/cache/{paper}/{wildcards.reading}/{chunk}.h5" for chunk in chunks]


def made(paths):
    """The recipes of artifacts, without what they are made from: Snakemake follows that itself."""
    recipes = (recipe(path)[2] for path in paths)
    return [{key: value for key, value in recipe.items() if key != "needs"} for recipe in recipes]


def stage_params(paper, stage, outputs):
    """The params of a stage's rule; chunks are temporary and leave no record, so that what gathers them has theirs."""
    return dict(
        paper=paper,
        entries=PAPERS[paper].stages[stage].entries,
        recipes=lambda wildcards: made(filled(path, wildcards) for path in outputs),
        chunks=lambda wildcards: made(chunk_files(paper, wildcards)) if stage == GATHER else [],
        build=build,
    )


# --- figures and tables

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
        quoted = quoting(filled(paper, wildcards), reading_of(wildcards))
        return {stem: as_rst(quoted.product(stem).caption) for stem in products(wildcards)}

    return artifacts, dict(
        script=lambda wildcards: kind[0] + "s",
        paper=lambda wildcards: filled(paper, wildcards),
        reading=reading_of,
        stems=lambda wildcards: list(products(wildcards)),
        inputs=inputs,
        published=lambda wildcards: source(published(wildcards)),
        printed=printed,
        captions=captions,
        **reached(f"{kind[0]}s.py", entries),
    )


# --- comparisons


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


# --- claims


def claims_entries(paper):
    """A paper's claims with what they share, and its tables over all readings."""
    summaries = [f"marsedl.papers.{paper}.tables:{stem}" for stem in PAPERS[paper].summaries]
    return [*DIGESTS.functions(f"marsedl.papers.{paper}.claims"), *summaries]
