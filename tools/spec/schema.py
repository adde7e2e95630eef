"""Generator of the JSON Schema of all messages, from the models."""

import json
from typing import Any

from pydantic.json_schema import models_json_schema

from armgate.protocol import messages as m

_ABOUT = (
    "The messages of the armgate protocol, version 1, as JSON values: binary data of msgpack is a text here. "
    "JSON has neither NaN nor infinities, which the dq of a command may contain, and does not distinguish 1 "
    "from 1.0. The text of the specification covers both."
)


def schema() -> str:
    """Return the schema, as JSON: ``$defs`` holds every message and map, and the messages of each side."""
    models = list(dict.fromkeys((*m.CLIENT_MESSAGES, *m.SERVER_MESSAGES)))
    _, found = models_json_schema([(model, "validation") for model in models])
    definitions = _bare(found["$defs"])
    for model in models:
        definitions[model.__name__]["required"] = ["type", *definitions[model.__name__].get("required", [])]
    sides = {"client": m.CLIENT_MESSAGES, "server": m.SERVER_MESSAGES}
    whole = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "armgate protocol 1",
        "description": _ABOUT,
        "anyOf": [{"$ref": f"#/$defs/{side}"} for side in sides],
        "$defs": {side: {"oneOf": [_ref(model) for model in members]} for side, members in sides.items()}
        | definitions,
    }
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def _ref(model: type[m.Message]) -> dict[str, str]:
    return {"$ref": f"#/$defs/{model.__name__}"}


def _bare(part: Any) -> Any:
    """Remove the titles, which repeat the field names, and put each description on one line."""
    if isinstance(part, list):
        return [_bare(item) for item in part]
    if not isinstance(part, dict):
        return part
    bare = {
        key: _bare(value) for key, value in part.items() if not (key == "title" and isinstance(value, str))
    }
    if isinstance(bare.get("description"), str):
        bare["description"] = " ".join(bare["description"].split()).replace("``", "")
    return bare
