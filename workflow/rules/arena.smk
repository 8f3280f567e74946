# Guidance laws side by side on one vehicle: tuned with equal budgets, flown in the same trials, in one process or in one
# for each chunk of trials, and shown.


rule arena:
    input:
        PRODUCTS.fought(),


rule arena_tuned:
    input:
        configuration=source("configs/scenarios/{scenario}.yaml"),
        paper=lambda wildcards: source(f"configs/{ARENAS[wildcards.scenario].paper}.yaml"),
        files=files_of("figures/arena/{scenario}/ranks.csv"),  # among them the sealed table
        rerun=if_stale("report/arena/{scenario}.tuned.json"),
    output:
        "report/arena/{scenario}.tuned.json",
    log:
        "logs/arena/{scenario}.tuned.log",
    benchmark:
        "benchmarks/arena/{scenario}.tuned.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/arena/{scenario}.tuned.json"),
        world=lambda wildcards: job_of("report/arena/{scenario}.flights", wildcards).params["world"],
        project=in_project("."),
    script:
        "../scripts/arena_tuned.py"


rule arena_flights:
    input:
        tuned="report/arena/{scenario}.tuned.json",
        configuration=source("configs/scenarios/{scenario}.yaml"),
        paper=lambda wildcards: source(f"configs/{ARENAS[wildcards.scenario].paper}.yaml"),
        rerun=if_stale("report/arena/{scenario}.{chunk}of{chunks}.h5"),
    output:
        "report/arena/{scenario}.{chunk}of{chunks}.h5",
    log:
        "logs/arena/{scenario}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/arena/{scenario}.{chunk}of{chunks}.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        given=params_of("report/arena/{scenario}.{chunk}of{chunks}.h5"),
        project=in_project("."),
    script:
        "../scripts/arena_flights.py"


# A rule for each scenario: its figures and tables are as many as it has.
for _name, _arena in ARENAS.items():

    rule:
        name:
            f"arena_{_name}"
        input:
            flights=lambda wildcards: [
                need
                for need in PRODUCTS.job(f"figures/arena/{wildcards.scenario}/ranks.csv").needs
                if need.endswith(".h5")
            ],
            tuned="report/arena/{scenario}.tuned.json",
            files=files_of("figures/arena/{scenario}/ranks.csv"),
            paper=source(f"configs/{_arena.paper}.yaml"),
            rerun=if_stale("figures/arena/{scenario}/ranks.csv"),
        output:
            png=[report(f"figures/arena/{{scenario}}/{stem}.png", category="arena") for stem in _arena.figures],
            pdf=[f"figures/arena/{{scenario}}/{stem}.pdf" for stem in _arena.figures],
            csv=[report(f"figures/arena/{{scenario}}/{stem}.csv", category="arena") for stem in _arena.tables],
            md=[f"figures/arena/{{scenario}}/{stem}.md" for stem in _arena.tables],
            sealed="report/arena/{scenario}.sealed.json",
        log:
            "logs/arena/{scenario}.log",
        benchmark:
            "benchmarks/arena/{scenario}.tsv"
        wildcard_constraints:
            scenario=_name,
        conda:
            "../envs/marsedl.yaml"
        params:
            given=params_of("figures/arena/{scenario}/ranks.csv"),
            project=in_project("."),
        script:
            "../scripts/arena_shown.py"
