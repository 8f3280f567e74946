# Snakemake runs this in the new environment, from the project's folder or from a build's folder in it.
for folder in . .. ../..; do
    test -e $folder/requirements.lock && break
done
python -m pip install --disable-pip-version-check --require-hashes --only-binary :all: --no-deps -r $folder/requirements.lock
