# The powered-descent paper: mass profile, linear model, gains, Monte Carlo, and the studies beside them.


rule powered_descent:
    input:
        products("powered_descent"),


rule powered_descent_nominal:
    output:
        cached("powered_descent", "nominal"),
    log:
        "logs/powered_descent/{reading}/nominal.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/nominal.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        **stage("powered_descent", "nominal"),
    script:
        "../scripts/stage.py"


use rule powered_descent_nominal as powered_descent_linearization with:
    input:
        **needs("powered_descent", "linearization"),
    output:
        cached("powered_descent", "linearization"),
    log:
        "logs/powered_descent/{reading}/linearization.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/linearization.tsv"
    params:
        **stage("powered_descent", "linearization"),


use rule powered_descent_nominal as powered_descent_gains with:
    input:
        **needs("powered_descent", "gains"),
    output:
        cached("powered_descent", "gains"),
    log:
        "logs/powered_descent/{reading}/gains.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/gains.tsv"
    params:
        **stage("powered_descent", "gains"),


use rule powered_descent_nominal as powered_descent_fixed_point with:
    input:
        **needs("powered_descent", "fixed_point"),
    output:
        cached("powered_descent", "fixed_point"),
    log:
        "logs/powered_descent/{reading}/fixed_point.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/fixed_point.tsv"
    params:
        **stage("powered_descent", "fixed_point"),


use rule powered_descent_nominal as powered_descent_certificates with:
    input:
        **needs("powered_descent", "certificates"),
    output:
        cached("powered_descent", "certificates"),
    log:
        "logs/powered_descent/{reading}/certificates.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/certificates.tsv"
    params:
        **stage("powered_descent", "certificates"),


use rule powered_descent_nominal as powered_descent_integrator_error with:
    input:
        **needs("powered_descent", "integrator_error"),
    output:
        cached("powered_descent", "integrator_error"),
    log:
        "logs/powered_descent/{reading}/integrator_error.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/integrator_error.tsv"
    params:
        **stage("powered_descent", "integrator_error"),


# A case that is not scattered is flown by one job; others by a job per chunk, and one that gathers them.


use rule powered_descent_nominal as powered_descent_montecarlo with:
    input:
        **needs("powered_descent", "montecarlo"),
    output:
        cached("powered_descent", "montecarlo.{case}"),
    log:
        "logs/powered_descent/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("powered_descent", scattered=False),
    params:
        **stage("powered_descent", "montecarlo"),
        options=trial_options("powered_descent"),


use rule powered_descent_nominal as powered_descent_montecarlo_chunk with:
    input:
        **needs("powered_descent", "montecarlo_chunk"),
    output:
        temp("data/cache/powered_descent/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/powered_descent/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    params:
        **stage("powered_descent", "montecarlo_chunk"),
        options=chunk_options("powered_descent"),


use rule powered_descent_nominal as powered_descent_montecarlo_gather with:
    input:
        chunks=chunk_files("powered_descent"),
    output:
        cached("powered_descent", "montecarlo.{case}"),
    log:
        "logs/powered_descent/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/powered_descent/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("powered_descent", scattered=True),
    params:
        **stage("powered_descent", "montecarlo_gather"),
        chunks=gathered_from("powered_descent", "montecarlo_chunk"),
