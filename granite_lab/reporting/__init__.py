"""Report, figures and recordings: leaves of the chain that nothing else imports."""
