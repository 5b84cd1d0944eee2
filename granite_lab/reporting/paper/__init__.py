"""The report of a study on four printed pages."""
