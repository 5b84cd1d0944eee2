from .write import write_compared, write_comparison, write_finding, write_report

__all__ = ["write_compared", "write_comparison", "write_finding", "write_report"]
