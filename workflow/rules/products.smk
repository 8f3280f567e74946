# Figures and tables: one job for each figure, and one for the tables of a reading that need the same artifacts. Those of
# the default reading stand right under figures/<paper>, of any other in its folder.
for _name, _kind, _paper, _stems in product_rules():
    _first = f"figures/{_paper}/{{place}}{_stems[0]}.{_kind[1][0]}"

    rule:
        name:
            _name
        input:
            unpack(product_artifacts(_paper, _stems)),
            changed=unproven(_first),
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
            script=lambda wildcards, _kind=_kind: f"{_kind[0]}s",
            paper=lambda wildcards, _paper=_paper: filled(_paper, wildcards),
            reading=reading_of,
            made=made(_first),
            published=lambda wildcards, _paper=_paper: source(filled(f"data/published/{_paper}.yaml", wildcards)),
            captions=product_captions(_paper, _stems),
            build=build,
        script:
            "../scripts/{params.script}.py"
