"""What has been collected, as values for programs."""

from typing import Any

from traverse.lab.collection.collection import Collection


def collection_report(collection: Collection) -> dict[str, Any]:
    """Touches of every feature, and whether there are as many as were wanted."""
    # Of a feature that comes again the last target counts all.
    last = {(one.artefact, one.feature): one for one in collection.targets}
    return {
        "campaign": str(collection.folder),
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
