"""Parameters with priors, whitened residuals, damped least squares and evidence."""
