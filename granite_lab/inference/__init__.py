"""Parameters with priors, whitened residuals, least squares by shortened steps and evidence."""
