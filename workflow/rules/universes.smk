# What decides every claim: a paper under all admissible answers to what is doubted about it, in chunks of universes that
# are computed in one process each, and the table, the pictures and the judgement of all.


rule multiverse:
    input:
        expand("report/universes/{paper}.h5", paper=PAPERS),


rule universes_chunk:
    input:
        unpack(inputs("report/universes/{paper}.h5")),
    output:
        temp("report/universes/{paper}.{chunk}of{chunks}.h5"),
    log:
        "logs/{paper}/universes.{chunk}of{chunks}.log",
    benchmark:
        "benchmarks/{paper}/universes.{chunk}of{chunks}.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/universes/{paper}.h5", recorded=False),
        project=source("."),
    script:
        "../scripts/universes_chunk.py"


rule universes:
    input:
        unpack(inputs("report/universes/{paper}.h5")),
        chunks=universe_chunks,
    output:
        table="report/universes/{paper}.h5",
        judged=expand("figures/{{paper}}/universes/claims.{suffix}", suffix=("csv", "md")),
        effects=expand("figures/{{paper}}/universes/effects.{suffix}", suffix=("csv", "md")),
        pictures=[
            "figures/{paper}/universes/heat_map.png",
            "figures/{paper}/universes/closing_in.png",
            *expand("figures/{{paper}}/universes/headline_{n}_{of}.png", n=HEADLINES, of=("values", "choices")),
        ],
    log:
        "logs/{paper}/universes.log",
    benchmark:
        "benchmarks/{paper}/universes.tsv"
    conda:
        "../envs/marsedl.yaml"
    params:
        made=made("report/universes/{paper}.h5"),
        project=source("."),
    script:
        "../scripts/universes.py"
