"""JSON Schemas of the files that people write, for editors.

python docs/file_schemas.py            writes docs/reference/file-schemas/
python docs/file_schemas.py --check    exit 1 where they differ

In draft 7, which taplo knows. Tables whose keys depend on their kind are `anyOf` with
the kind as a constant. What holds between keys is checked by `traverse check` alone.
"""

import inspect
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.config.filters import FilterSection
from traverse.daemon.config.schema import Configuration
from traverse.drivers.base.registry import DRIVERS
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.filters import FILTERS
from traverse.lab.artefacts import ARTEFACT_KINDS
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.simulator.campaigns.dense.spec import DenseFile
from traverse.simulator.campaigns.spec import CampaignFile as SimulatedCampaignFile
from traverse.simulator.config import SimulatorConfig
from traverse.simulator.kind_table import KindTable

FOLDER = Path(__file__).parent / "reference" / "file-schemas"
DRAFT = "http://json-schema.org/draft-07/schema#"
FILES: dict[str, type[BaseModel]] = {
    "arm": Arm,
    "campaign": CampaignFile,
    "configuration": Configuration,
    "simulator": SimulatorConfig,
    "simulated-campaign": SimulatedCampaignFile,
    "simulated-scan": DenseFile,
}
_ENTRY = re.compile(r"^    (\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)


class FileSchema(GenerateJsonSchema):
    """Schemas of models with families of tables, described by their docstrings."""

    def model_schema(self, schema: Any) -> JsonSchemaValue:  # noqa: ANN401 - of pydantic's core
        """Make the schema of a model, or of any of its family."""
        cls = schema["cls"]
        members = _members(cls)
        if members is not None:
            key, default, kinds = members
            return self._any_of(key, default, kinds)
        json_schema = super().model_schema(schema)
        about, *sections = re.split(r"\n\n(?=Attributes:\n)", inspect.getdoc(cls) or "")
        json_schema["description"] = " ".join(about.split())
        for name, text in _ENTRY.findall("".join(sections)):
            field = cls.model_fields.get(name)
            described = json_schema["properties"].get((field and field.alias) or name)
            if described is not None and "$ref" not in described:
                described["description"] = " ".join(text.split())
        if cls is CampaignFile:
            kinds = ((kind, table) for kind, table in ARTEFACT_KINDS.items())
            json_schema["properties"]["artefacts"]["items"] = self._any_of(
                "kind", None, kinds
            )
        return json_schema

    def _any_of(
        self,
        key: str,
        default: str | None,
        kinds: Iterable[tuple[str, type[BaseModel]]],
    ) -> JsonSchemaValue:
        return {
            "anyOf": [
                {
                    "allOf": [self.generate_inner(table.__pydantic_core_schema__)],
                    "properties": {key: {"const": kind}},
                    "required": [] if kind == default else [key],
                }
                for kind, table in kinds
            ]
        }


def _members(
    cls: type[BaseModel],
) -> tuple[str, str | None, Iterable[tuple[str, type[BaseModel]]]] | None:
    """Return the key, the default and the kinds of a family; None for any other."""
    by_class: dict[type[BaseModel], tuple[str, Iterable[str]]] = {
        Effect: ("kind", EFFECT_KINDS),
        DeviceSection: ("driver", DRIVERS),
        FilterSection: ("kind", FILTERS),
    }
    if issubclass(cls, KindTable) and "FAMILY" in cls.__dict__:
        default = cls.model_fields["kind"].get_default()
        of = ((kind, cls.class_of(kind)) for kind in cls.KINDS)
        return "kind", default if isinstance(default, str) else None, of
    if cls not in by_class:
        return None
    key, names = by_class[cls]
    return key, None, ((name, cls.variant({key: name})) for name in names)  # type: ignore[attr-defined]  # of each of these


def schemas() -> dict[str, dict[str, Any]]:
    return {name: _draft_7(_schema(name, model)) for name, model in FILES.items()}


def _schema(name: str, model: type[BaseModel]) -> dict[str, Any]:
    schema = model.model_json_schema(schema_generator=FileSchema)
    return {"$schema": DRAFT, "$id": f"traverse/{name}", **schema}


def _draft_7(value: Any) -> Any:  # noqa: ANN401 - of JSON
    """Write lists of fixed length as draft 7 has them."""
    if isinstance(value, list):
        return [_draft_7(entry) for entry in value]
    if not isinstance(value, dict):
        return value
    new = {key: _draft_7(entry) for key, entry in value.items()}
    if "prefixItems" in new:
        new["items"] = new.pop("prefixItems")
    return new


def texts() -> dict[str, str]:
    return {
        f"{name}.schema.json": json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
        for name, schema in schemas().items()
    }


def main() -> int:
    if "--check" in sys.argv[1:]:
        differ = [
            name
            for name, text in texts().items()
            if not (FOLDER / name).is_file() or (FOLDER / name).read_text() != text
        ]
        sys.stderr.writelines(f"{name} differs: make schemas\n" for name in differ)
        return bool(differ)
    FOLDER.mkdir(exist_ok=True)
    for name, text in texts().items():
        (FOLDER / name).write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
