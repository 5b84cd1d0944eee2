from .evidence import bare_section, section

__all__ = ["bare_section", "section"]
