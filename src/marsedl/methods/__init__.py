"""What acts on the models: linearization, guidance and control design, optimisation."""
