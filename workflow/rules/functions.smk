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
        taken = SHARED[paper].files(wildcards.reading, PAPERS[paper].stages[stage].needs)
        return taken | (dict(chunks=chunk_files(paper, wildcards)) if stage == GATHER else {})

    return named


def chunk_files(paper, wildcards):
    """The files of all chunks of a Monte Carlo case."""
    chunks = SHARED[paper].chunks(wildcards.reading, wildcards.case)
    return [f"data/cache/{paper}/{wildcards.reading}/{chunk}.h5" for chunk in chunks]


def recipes_of(outputs):
    """The recipes of a stage's artifacts, without what these are made from: Snakemake follows that itself."""

    def recipes(wildcards):
        own = (RECIPES.job(filled(path, wildcards)).own for path in outputs)
        return [{key: value for key, value in recipe.items() if key != "needs"} for recipe in own]

    return recipes


# --- figures and tables

FIGURE, TABLES = ("figure", ("png", "pdf")), ("table", ("csv", "md"))


def product_rules():
    """Name and kind of each rule, its paper and the names of its products; those of all figures are wildcards."""
    yield "figure", FIGURE, "{paper}", ["{stem}"]
    for paper, catalogue in PAPERS.items():
        for tables in catalogue.tables_of_equal_needs():
            yield f"{paper}_table_{tables[0]}", TABLES, paper, tables


def reading_of(wildcards):
    """The reading in whose folder a product stands."""
    return wildcards.place.strip("/") or CORRECTED


def product_files(kind, paper, stems):
    """Files of a rule's products, of which the first of each is shown by `snakemake --report`."""

    def labels_of(stem):
        return lambda wildcards: {"reading": reading_of(wildcards), "item": filled(stem, wildcards), "kind": kind[0]}

    for stem in stems:
        shown, other = (f"figures/{paper}/{{place}}{stem}.{suffix}" for suffix in kind[1])
        place = dict(category=paper, subcategory=reading_of, labels=labels_of(stem))
        yield report(shown, caption=f"../report/{kind[0]}.rst", **place)
        yield other


def stems_of(paper, stems):
    """The names of a rule's products."""
    return lambda wildcards: [filled(stem, wildcards) for stem in stems]


def product_artifacts(paper, stems):
    """The artifacts of a rule's products, by the name of the parameter that takes them."""

    def artifacts(wildcards):
        product = PAPERS[filled(paper, wildcards)].product(filled(stems[0], wildcards))
        return SHARED[filled(paper, wildcards)].files(reading_of(wildcards), product.needs, product.optional)

    return artifacts


def product_captions(paper, stems):
    """The captions of a rule's products."""

    def captions(wildcards, output):
        quoted = quoting(filled(paper, wildcards), reading_of(wildcards))
        return {stem: as_rst(quoted.product(stem).caption) for stem in stems_of(paper, stems)(wildcards)}

    return captions


# --- comparisons


def comparison_captions(wildcards, output):
    """Captions of the figure and the table of a comparison."""
    written = COMPARISONS[wildcards.stem]
    return {"figure": as_rst(written.figure), "table": as_rst(written.table)}


def comparison_shown(kind, suffix):
    """A file of a comparison, which `snakemake --report` shows."""
    labels = {"reading": CORRECTED, "item": "{stem}", "kind": kind}
    place = dict(category="comparison of the papers", subcategory=CORRECTED, labels=labels)
    return report(f"figures/comparison/{{stem}}.{suffix}", caption=f"../report/comparison_{kind}.rst", **place)
