from .write import write_comparison, write_discovery, write_finding, write_report

__all__ = ["write_comparison", "write_discovery", "write_finding", "write_report"]
