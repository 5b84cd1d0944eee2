"""One inference for every question: parameters with priors, whitened residuals, damped least squares, evidence."""
