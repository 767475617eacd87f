"""3MF files made to harm: refused in one line, before anything is unpacked."""

from __future__ import annotations

import io
import zipfile

import pytest

from planner.errors import MeshError
from planner.mesh.load import load_bytes
from tests.fuzz.seeds import CONTENT_TYPES, MODEL, model_3mf

MODEL_XML = model_3mf()
HEAD, REST = MODEL_XML.split("?>", 1)
ENTITIES = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))


def packed(model: str | bytes = MODEL_XML, more: dict[str, bytes] | None = None) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in {"[Content_Types].xml": CONTENT_TYPES, MODEL: model, **(more or {})}.items():
            archive.writestr(name, content)
    return target.getvalue()


HOSTILE = {
    "an entity that multiplies": (packed(f'{HEAD}?><!DOCTYPE m [<!ENTITY a0 "ha">{ENTITIES}]>{REST}'), "holds a DTD"),
    "an entity of another file": (packed(f'{HEAD}?><!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]>{REST}'), "holds a DTD"),
    "a DTD in 16-bit text": (packed(f"{HEAD}?><!DOCTYPE m>{REST}".encode("utf-16")), "holds a DTD"),
    "a path that climbs": (packed(more={"../../evil": b"x"}), "the path '../../evil'"),
    "a path from the root": (packed(more={"/etc/evil": b"x"}), "the path '/etc/evil'"),
    "a path with backslashes": (packed(more={"3D\\..\\..\\evil": b"x"}), "the path"),
    "too many entries": (packed(more={f"x{k}": b"" for k in range(1001)}), "1003 entries"),
    "nothing but blanks": (packed(more={"3D/big": b" " * 30_000_000}), "unpacks from"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_archive_made_to_harm_is_refused_in_one_line(what: str) -> None:
    data, words = HOSTILE[what]
    with pytest.raises(MeshError) as caught:
        load_bytes(data, ".3mf")
    assert words in caught.value.message and "\n" not in caught.value.message and caught.value.hint


def test_size_that_lies_is_noticed() -> None:
    data = bytearray(packed(MODEL_XML.replace("<resources>", " " * 1_000_000 + "<resources>")))
    at = data.rfind(MODEL.encode()) - 46  # the entry in the central directory
    data[at + 24 : at + 28] = (1000).to_bytes(4, "little")
    with pytest.raises(MeshError):
        load_bytes(bytes(data), ".3mf")


def test_sound_archive_is_read() -> None:
    assert len(load_bytes(packed(), ".3mf").facets) == 4
