"""Which trial to drive next: expected standard deviations and Bayes factors, by linear algebra."""
