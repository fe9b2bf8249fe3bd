"""Collected touches, as values for programs."""

from typing import Any

from traverse.lab.collection.collection import CAMPAIGN, Collection
from traverse.lab.report.provenance import (
    ReportSource,
    digest_of_files,
    report_provenance,
)


def collection_report(collection: Collection) -> dict[str, Any]:
    """Touches of every feature, and whether they reach the target."""
    # The last target of a recurring feature includes all its touches.
    last = {(one.artefact, one.feature): one for one in collection.targets}
    table = collection.folder / collection.file.poses
    files = [path for path in (collection.folder / CAMPAIGN, table) if path.is_file()]
    source = ReportSource(collection.folder.resolve().name, digest_of_files(files))
    return {
        "campaign": str(collection.folder),
        "provenance": report_provenance(source).values,
        "poses": len(collection.touches),
        "complete": not collection.unfinished(),
        "features": [
            {
                "artefact": one.artefact,
                "feature": one.feature or None,
                "touches": collection.count(one),
                "wanted": one.wanted,
            }
            for one in last.values()
        ],
    }
