# The funnels paper: nominal, linear model, regulator, funnel, flights, and the studies beside them.


rule funnels:
    input:
        products("funnels"),


rule funnels_nominal:
    output:
        cached("funnels", "nominal"),
    log:
        "logs/funnels/{reading}/nominal.log",
    benchmark:
        "benchmarks/funnels/{reading}/nominal.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        **stage("funnels", "nominal"),
    script:
        "../scripts/stage.py"


use rule funnels_nominal as funnels_optima with:
    output:
        cached("funnels", "optima"),
    log:
        "logs/funnels/{reading}/optima.log",
    benchmark:
        "benchmarks/funnels/{reading}/optima.tsv"
    params:
        **stage("funnels", "optima"),


use rule funnels_nominal as funnels_linearization with:
    input:
        **needs("funnels", "linearization"),
    output:
        cached("funnels", "linearization"),
    log:
        "logs/funnels/{reading}/linearization.log",
    benchmark:
        "benchmarks/funnels/{reading}/linearization.tsv"
    params:
        **stage("funnels", "linearization"),


use rule funnels_nominal as funnels_gains with:
    input:
        **needs("funnels", "gains"),
    output:
        cached("funnels", "gains"),
    log:
        "logs/funnels/{reading}/gains.log",
    benchmark:
        "benchmarks/funnels/{reading}/gains.tsv"
    params:
        **stage("funnels", "gains"),


use rule funnels_nominal as funnels_funnel with:
    input:
        **needs("funnels", "funnel"),
    output:
        cached("funnels", "funnel"),
    log:
        "logs/funnels/{reading}/funnel.log",
    benchmark:
        "benchmarks/funnels/{reading}/funnel.tsv"
    params:
        **stage("funnels", "funnel"),


use rule funnels_nominal as funnels_linear_bounds with:
    input:
        **needs("funnels", "linear_bounds"),
    output:
        cached("funnels", "linear_bounds"),
    log:
        "logs/funnels/{reading}/linear_bounds.log",
    benchmark:
        "benchmarks/funnels/{reading}/linear_bounds.tsv"
    params:
        **stage("funnels", "linear_bounds"),


use rule funnels_nominal as funnels_stage_study with:
    input:
        **needs("funnels", "stage_study"),
    output:
        cached("funnels", "stage_study"),
    log:
        "logs/funnels/{reading}/stage_study.log",
    benchmark:
        "benchmarks/funnels/{reading}/stage_study.tsv"
    params:
        **stage("funnels", "stage_study"),


use rule funnels_nominal as funnels_certificates with:
    input:
        **needs("funnels", "certificates"),
    output:
        cached("funnels", "certificates"),
    log:
        "logs/funnels/{reading}/certificates.log",
    benchmark:
        "benchmarks/funnels/{reading}/certificates.tsv"
    priority: 1  # the longest job: it must not be left for the end
    params:
        **stage("funnels", "certificates"),


use rule funnels_nominal as funnels_proven with:
    input:
        **needs("funnels", "proven"),
    output:
        cached("funnels", "proven"),
    log:
        "logs/funnels/{reading}/proven.log",
    benchmark:
        "benchmarks/funnels/{reading}/proven.tsv"
    params:
        **stage("funnels", "proven"),


use rule funnels_nominal as funnels_dubins with:
    output:
        cached("funnels", "dubins"),
    log:
        "logs/funnels/{reading}/dubins.log",
    benchmark:
        "benchmarks/funnels/{reading}/dubins.tsv"
    params:
        **stage("funnels", "dubins"),


use rule funnels_nominal as funnels_dubins_study with:
    input:
        **needs("funnels", "dubins_study"),
    output:
        cached("funnels", "dubins_study"),
    log:
        "logs/funnels/{reading}/dubins_study.log",
    benchmark:
        "benchmarks/funnels/{reading}/dubins_study.tsv"
    params:
        **stage("funnels", "dubins_study"),


use rule funnels_nominal as funnels_dubins_calm with:
    input:
        **needs("funnels", "dubins_calm"),
    output:
        cached("funnels", "dubins_calm"),
    log:
        "logs/funnels/{reading}/dubins_calm.log",
    benchmark:
        "benchmarks/funnels/{reading}/dubins_calm.tsv"
    params:
        **stage("funnels", "dubins_calm"),


use rule funnels_nominal as funnels_dubins_wind with:
    input:
        **needs("funnels", "dubins_wind"),
    output:
        cached("funnels", "dubins_wind"),
    log:
        "logs/funnels/{reading}/dubins_wind.log",
    benchmark:
        "benchmarks/funnels/{reading}/dubins_wind.tsv"
    params:
        **stage("funnels", "dubins_wind"),


# A case that is not scattered is flown by one job; others by a job per chunk, and one that gathers them.


use rule funnels_nominal as funnels_montecarlo with:
    input:
        **needs("funnels", "montecarlo"),
    output:
        cached("funnels", "montecarlo.{case}"),
    log:
        "logs/funnels/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/funnels/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("funnels", scattered=False),
    params:
        **stage("funnels", "montecarlo"),
        options=trial_options("funnels"),


use rule funnels_nominal as funnels_montecarlo_chunk with:
    input:
        **needs("funnels", "montecarlo_chunk"),
    output:
        temp("data/cache/funnels/{reading}/chunks/{case}.{chunk}of{chunks}.h5"),
    log:
        "logs/funnels/{reading}/montecarlo.{case}.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/funnels/{reading}/montecarlo.{case}.{chunk}of{chunks}.tsv"
    params:
        **stage("funnels", "montecarlo_chunk"),
        options=chunk_options("funnels"),


use rule funnels_nominal as funnels_montecarlo_gather with:
    input:
        **needs("funnels", "montecarlo_gather"),
        chunks=chunk_files("funnels"),
    output:
        cached("funnels", "montecarlo.{case}"),
    log:
        "logs/funnels/{reading}/montecarlo.{case}.log",
    benchmark:
        "benchmarks/funnels/{reading}/montecarlo.{case}.tsv"
    wildcard_constraints:
        case=cases_of("funnels", scattered=True),
    params:
        **stage("funnels", "montecarlo_gather"),
        chunks=gathered_from("funnels", "montecarlo_chunk"),
