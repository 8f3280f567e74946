# The entry-guidance paper: nominal flight, linear model, gains, Monte Carlo, and the studies beside them.


rule stochastic_entry:
    input:
        products("stochastic_entry"),


rule stochastic_entry_nominal:
    output:
        cached("stochastic_entry", "nominal"),
    log:
        "logs/stochastic_entry/{reading}/nominal.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/nominal.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        **stage("stochastic_entry", "nominal"),
    script:
        "../scripts/stage.py"


use rule stochastic_entry_nominal as stochastic_entry_linearization with:
    input:
        **needs("stochastic_entry", "linearization"),
    output:
        cached("stochastic_entry", "linearization"),
    log:
        "logs/stochastic_entry/{reading}/linearization.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/linearization.tsv"
    params:
        **stage("stochastic_entry", "linearization"),


use rule stochastic_entry_nominal as stochastic_entry_gains with:
    input:
        **needs("stochastic_entry", "gains"),
    output:
        cached("stochastic_entry", "gains"),
    log:
        "logs/stochastic_entry/{reading}/gains.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/gains.tsv"
    params:
        **stage("stochastic_entry", "gains"),


use rule stochastic_entry_nominal as stochastic_entry_certificates with:
    input:
        **needs("stochastic_entry", "certificates"),
    output:
        cached("stochastic_entry", "certificates"),
    log:
        "logs/stochastic_entry/{reading}/certificates.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/certificates.tsv"
    params:
        **stage("stochastic_entry", "certificates"),


use rule stochastic_entry_nominal as stochastic_entry_tradeoff with:
    input:
        **needs("stochastic_entry", "tradeoff"),
    output:
        cached("stochastic_entry", "tradeoff"),
    log:
        "logs/stochastic_entry/{reading}/tradeoff.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/tradeoff.tsv"
    params:
        **stage("stochastic_entry", "tradeoff"),


use rule stochastic_entry_nominal as stochastic_entry_error_budget with:
    input:
        **needs("stochastic_entry", "error_budget"),
    output:
        cached("stochastic_entry", "error_budget"),
    log:
        "logs/stochastic_entry/{reading}/error_budget.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/error_budget.tsv"
    params:
        **stage("stochastic_entry", "error_budget"),


# A case that is not scattered is flown by one job; others by a job per chunk, and one that gathers them.


use rule stochastic_entry_nominal as stochastic_entry_montecarlo with:
    input:
        **needs("stochastic_entry", "montecarlo"),
    output:
        cached("stochastic_entry", "montecarlo.{case}"),
    log:
        "logs/stochastic_entry/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("stochastic_entry", scattered=False),
    params:
        **stage("stochastic_entry", "montecarlo"),
        options=trial_options("stochastic_entry"),


use rule stochastic_entry_nominal as stochastic_entry_montecarlo_chunk with:
    input:
        **needs("stochastic_entry", "montecarlo_chunk"),
    output:
        temp("data/cache/stochastic_entry/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/stochastic_entry/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    params:
        **stage("stochastic_entry", "montecarlo_chunk"),
        options=chunk_options("stochastic_entry"),


use rule stochastic_entry_nominal as stochastic_entry_montecarlo_gather with:
    input:
        chunks=chunk_files("stochastic_entry"),
    output:
        cached("stochastic_entry", "montecarlo.{case}"),
    log:
        "logs/stochastic_entry/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/stochastic_entry/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("stochastic_entry", scattered=True),
    params:
        **stage("stochastic_entry", "montecarlo_gather"),
        chunks=gathered_from("stochastic_entry", "montecarlo_chunk"),
