# Figures and tables: one job for each figure, and one for the tables of a reading that need the same artifacts. Those of
# the default reading stand right under figures/<paper>, of any other in its folder.
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
            "../scripts/{params.script}.py"
