# The random-field paper: nominal flight, linear model, gains, Monte Carlo, double integrator, and the studies beside them.


rule random_field:
    input:
        products("random_field"),


rule random_field_nominal:
    output:
        cached("random_field", "nominal"),
    log:
        "logs/random_field/{reading}/nominal.log",
    benchmark:
        "benchmarks/random_field/{reading}/nominal.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        **stage("random_field", "nominal"),
    script:
        "../scripts/stage.py"


use rule random_field_nominal as random_field_linearization with:
    input:
        **needs("random_field", "linearization"),
    output:
        cached("random_field", "linearization"),
    log:
        "logs/random_field/{reading}/linearization.log",
    benchmark:
        "benchmarks/random_field/{reading}/linearization.tsv"
    params:
        **stage("random_field", "linearization"),


use rule random_field_nominal as random_field_gains with:
    input:
        **needs("random_field", "gains"),
    output:
        cached("random_field", "gains"),
    log:
        "logs/random_field/{reading}/gains.log",
    benchmark:
        "benchmarks/random_field/{reading}/gains.tsv"
    params:
        **stage("random_field", "gains"),


use rule random_field_nominal as random_field_certificates with:
    input:
        **needs("random_field", "certificates"),
    output:
        cached("random_field", "certificates"),
    log:
        "logs/random_field/{reading}/certificates.log",
    benchmark:
        "benchmarks/random_field/{reading}/certificates.tsv"
    params:
        **stage("random_field", "certificates"),


use rule random_field_nominal as random_field_convergence with:
    input:
        **needs("random_field", "convergence"),
    output:
        cached("random_field", "convergence"),
    log:
        "logs/random_field/{reading}/convergence.log",
    benchmark:
        "benchmarks/random_field/{reading}/convergence.tsv"
    params:
        **stage("random_field", "convergence"),


use rule random_field_nominal as random_field_regularization with:
    input:
        **needs("random_field", "regularization"),
    output:
        cached("random_field", "regularization"),
    log:
        "logs/random_field/{reading}/regularization.log",
    benchmark:
        "benchmarks/random_field/{reading}/regularization.tsv"
    params:
        **stage("random_field", "regularization"),


use rule random_field_nominal as random_field_field_study with:
    input:
        **needs("random_field", "field_study"),
    output:
        cached("random_field", "field_study"),
    log:
        "logs/random_field/{reading}/field_study.log",
    benchmark:
        "benchmarks/random_field/{reading}/field_study.tsv"
    params:
        **stage("random_field", "field_study"),


use rule random_field_nominal as random_field_double_integrator with:
    input:
        **needs("random_field", "double_integrator"),
    output:
        cached("random_field", "double_integrator"),
    log:
        "logs/random_field/{reading}/double_integrator.log",
    benchmark:
        "benchmarks/random_field/{reading}/double_integrator.tsv"
    params:
        **stage("random_field", "double_integrator"),


use rule random_field_nominal as random_field_double_integrator_flights with:
    input:
        **needs("random_field", "double_integrator_flights"),
    output:
        cached("random_field", "double_integrator_flights"),
    log:
        "logs/random_field/{reading}/double_integrator_flights.log",
    benchmark:
        "benchmarks/random_field/{reading}/double_integrator_flights.tsv"
    params:
        **stage("random_field", "double_integrator_flights"),


# A case that is not scattered is flown by one job; others by a job per chunk, and one that gathers them.


use rule random_field_nominal as random_field_montecarlo with:
    input:
        **needs("random_field", "montecarlo"),
    output:
        cached("random_field", "montecarlo.{case}"),
    log:
        "logs/random_field/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/random_field/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("random_field", scattered=False),
    params:
        **stage("random_field", "montecarlo"),
        options=trial_options("random_field"),


use rule random_field_nominal as random_field_montecarlo_chunk with:
    input:
        **needs("random_field", "montecarlo_chunk"),
    output:
        temp("data/cache/random_field/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/random_field/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/random_field/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    params:
        **stage("random_field", "montecarlo_chunk"),
        options=chunk_options("random_field"),


use rule random_field_nominal as random_field_montecarlo_gather with:
    input:
        chunks=chunk_files("random_field"),
    output:
        cached("random_field", "montecarlo.{case}"),
    log:
        "logs/random_field/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/random_field/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("random_field", scattered=True),
    params:
        **stage("random_field", "montecarlo_gather"),
        chunks=gathered_from("random_field", "montecarlo_chunk"),
