# Reproducibility: the smoke size twice in separate folders, then the full size against the committed numbers.


rule verify:
    input:
        "report/claims.json",
    log:
        "logs/verify.log",
    conda:
        "../envs/marsedl.yaml"
    params:
        python=sys.executable,
    shell:
        "{params.python:q} -m marsedl.cli verify 2> {log}"
