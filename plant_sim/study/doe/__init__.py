"""Design of experiments: designs, regression, optimum."""
