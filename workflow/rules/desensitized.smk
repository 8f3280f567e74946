# The desensitized-landing paper: nominal, trade-off, linear model, gains, flights, and the studies beside them.


rule desensitized:
    input:
        products("desensitized"),


rule desensitized_nominal:
    output:
        cached("desensitized", "nominal"),
    log:
        "logs/desensitized/{reading}/nominal.log",
    benchmark:
        "benchmarks/desensitized/{reading}/nominal.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        **stage("desensitized", "nominal"),
    script:
        "../scripts/stage.py"


use rule desensitized_nominal as desensitized_tradeoff with:
    input:
        **needs("desensitized", "tradeoff"),
    output:
        cached("desensitized", "tradeoff"),
    log:
        "logs/desensitized/{reading}/tradeoff.log",
    benchmark:
        "benchmarks/desensitized/{reading}/tradeoff.tsv"
    params:
        **stage("desensitized", "tradeoff"),


use rule desensitized_nominal as desensitized_linearization with:
    input:
        **needs("desensitized", "linearization"),
    output:
        cached("desensitized", "linearization"),
    log:
        "logs/desensitized/{reading}/linearization.log",
    benchmark:
        "benchmarks/desensitized/{reading}/linearization.tsv"
    params:
        **stage("desensitized", "linearization"),


use rule desensitized_nominal as desensitized_gains with:
    input:
        **needs("desensitized", "gains"),
    output:
        cached("desensitized", "gains"),
    log:
        "logs/desensitized/{reading}/gains.log",
    benchmark:
        "benchmarks/desensitized/{reading}/gains.tsv"
    params:
        **stage("desensitized", "gains"),


use rule desensitized_nominal as desensitized_responses with:
    input:
        **needs("desensitized", "responses"),
    output:
        cached("desensitized", "responses"),
    log:
        "logs/desensitized/{reading}/responses.log",
    benchmark:
        "benchmarks/desensitized/{reading}/responses.tsv"
    params:
        **stage("desensitized", "responses"),


use rule desensitized_nominal as desensitized_gain_study with:
    input:
        **needs("desensitized", "gain_study"),
    output:
        cached("desensitized", "gain_study"),
    log:
        "logs/desensitized/{reading}/gain_study.log",
    benchmark:
        "benchmarks/desensitized/{reading}/gain_study.tsv"
    params:
        **stage("desensitized", "gain_study"),


use rule desensitized_nominal as desensitized_branches with:
    input:
        **needs("desensitized", "branches"),
    output:
        cached("desensitized", "branches"),
    log:
        "logs/desensitized/{reading}/branches.log",
    benchmark:
        "benchmarks/desensitized/{reading}/branches.tsv"
    params:
        **stage("desensitized", "branches"),


use rule desensitized_nominal as desensitized_minimum_fuel with:
    input:
        **needs("desensitized", "minimum_fuel"),
    output:
        cached("desensitized", "minimum_fuel"),
    log:
        "logs/desensitized/{reading}/minimum_fuel.log",
    benchmark:
        "benchmarks/desensitized/{reading}/minimum_fuel.tsv"
    params:
        **stage("desensitized", "minimum_fuel"),


use rule desensitized_nominal as desensitized_certificates with:
    input:
        **needs("desensitized", "certificates"),
    output:
        cached("desensitized", "certificates"),
    log:
        "logs/desensitized/{reading}/certificates.log",
    benchmark:
        "benchmarks/desensitized/{reading}/certificates.tsv"
    params:
        **stage("desensitized", "certificates"),


use rule desensitized_nominal as desensitized_further_perturbations with:
    input:
        **needs("desensitized", "further_perturbations"),
    output:
        cached("desensitized", "further_perturbations"),
    log:
        "logs/desensitized/{reading}/further_perturbations.log",
    benchmark:
        "benchmarks/desensitized/{reading}/further_perturbations.tsv"
    params:
        **stage("desensitized", "further_perturbations"),


# A case that is not scattered is flown by one job; others by a job per chunk, and one that gathers them.


use rule desensitized_nominal as desensitized_montecarlo with:
    input:
        **needs("desensitized", "montecarlo"),
    output:
        cached("desensitized", "montecarlo.{case}"),
    log:
        "logs/desensitized/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/desensitized/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("desensitized", scattered=False),
    params:
        **stage("desensitized", "montecarlo"),
        options=trial_options("desensitized"),


use rule desensitized_nominal as desensitized_montecarlo_chunk with:
    input:
        **needs("desensitized", "montecarlo_chunk"),
    output:
        temp("data/cache/desensitized/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/desensitized/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/desensitized/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    params:
        **stage("desensitized", "montecarlo_chunk"),
        options=chunk_options("desensitized"),


use rule desensitized_nominal as desensitized_montecarlo_gather with:
    input:
        **needs("desensitized", "montecarlo_gather"),
        chunks=chunk_files("desensitized"),
    output:
        cached("desensitized", "montecarlo.{case}"),
    log:
        "logs/desensitized/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/desensitized/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("desensitized", scattered=True),
    params:
        **stage("desensitized", "montecarlo_gather"),
        chunks=gathered_from("desensitized", "montecarlo_chunk"),
