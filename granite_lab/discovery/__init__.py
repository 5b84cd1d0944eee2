"""From trials that the model does not explain to the effect that is missing, and how sure that is."""

from granite_lab.discovery.as_json import finding_as_json
from granite_lab.discovery.discover import discover
from granite_lab.discovery.finding import Finding

__all__ = ["Finding", "discover", "finding_as_json"]
