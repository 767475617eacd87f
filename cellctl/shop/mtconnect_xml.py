"""The documents of an MTConnect agent as XML 2.0: Devices, Streams, Assets, Error. Source: MTConnect Part 1 to 4, version 2.0."""

from __future__ import annotations

import socket
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from cellctl.shop.mirror import BUFFER, Mirror, Observation
from cellctl.shop.mtconnect_words import Active, Component, Item, components_of
from cellctl.shop.shdr import UNAVAILABLE, timestamp
from config.cell import Cell, Tool

VERSION = "2.0"
HEADER_VERSION = "2.0.0.1"
OWN = "urn:hybridcell:mtconnect:1"  # of x:MASS_FLOW
CATEGORY = {"SAMPLE": "Samples", "EVENT": "Events", "CONDITION": "Condition"}
LEVEL = {"FAULT": "Fault", "WARNING": "Warning", "NORMAL": "Normal"}


def _root(kind: str, mirror: Mirror, at: float, **header: object) -> ET.Element:
    root = ET.Element(f"MTConnect{kind}", {"xmlns": f"urn:mtconnect.org:MTConnect{kind}:{VERSION}", "xmlns:x": OWN})
    told = {
        "creationTime": timestamp(at), "sender": socket.gethostname(), "instanceId": mirror.instance, "version": HEADER_VERSION,
        "deviceModelChangeTime": timestamp(mirror.instance), **header,
    }  # fmt: skip
    ET.SubElement(root, "Header", {name: str(value) for name, value in told.items()})
    return root


def as_bytes(root: ET.Element) -> bytes:
    """The document as it is sent."""
    ET.indent(root)
    text: str = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def legal(text: str) -> str:
    """Text without the characters that XML 1.0 has no way to say."""
    return "".join(char if char in "\t\n\r" or " " <= char <= "\ud7ff" or "\ue000" <= char <= "\ufffd" or char > "\uffff" else " " for char in text)


def uuid_of(cell: Cell) -> str:
    """The device's uuid: stays as long as the cell keeps its name."""
    return f"hybridcell-{cell.name}"


def devices(mirror: Mirror, at: float) -> bytes:
    """The answer to /probe: the device with its components and data items."""
    cell = mirror.cell
    tools = len(tool_assets(cell))
    root = _root("Devices", mirror, at, bufferSize=BUFFER, assetBufferSize=max(tools, 1), assetCount=tools)
    device = ET.SubElement(
        ET.SubElement(root, "Devices"), "Device", id="device", name=cell.name, uuid=uuid_of(cell), mtconnectVersion=VERSION
    )
    description = ET.SubElement(device, "Description", model="hybrid metal cell")
    description.text = "Five-axis cell that deposits and mills" + (" (simulated)" if cell.mode == "sim" else "")
    nodes: dict[str, ET.Element] = {"": device}
    _data_items(device, [item for item in mirror.items if item.component == ""])
    for one in components_of(cell):
        holder = nodes[one.inside]
        inner = holder.find("Components")
        node = ET.SubElement(ET.SubElement(holder, "Components") if inner is None else inner, one.element, id=one.id, name=one.name)
        nodes[one.id] = node
        _data_items(node, [item for item in mirror.items if item.component == one.id])
    return as_bytes(root)


def _data_items(node: ET.Element, items: list[Item]) -> None:
    if not items:
        return
    held = ET.SubElement(node, "DataItems")
    for item in items:
        given = {"id": item.id, "category": item.category, "type": item.type, "subType": item.sub_type, "units": item.units}
        ET.SubElement(held, "DataItem", {name: value for name, value in (*given.items(), *item.attributes) if value})


def streams(mirror: Mirror, at: float, told: Iterable[Observation], following: int) -> bytes:
    """The answer to /current and /sample. following : number to go on from"""
    header = {
        "bufferSize": BUFFER, "firstSequence": mirror.first_sequence, "lastSequence": mirror.next_sequence - 1, "nextSequence": following,
    }  # fmt: skip
    root = _root("Streams", mirror, at, **header)
    device = ET.SubElement(ET.SubElement(root, "Streams"), "DeviceStream", name=mirror.cell.name, uuid=uuid_of(mirror.cell))
    by_component: dict[str, list[Observation]] = {}
    for one in told:
        by_component.setdefault(one.item.component, []).append(one)
    for component in (Component("device", "Device", mirror.cell.name), *components_of(mirror.cell)):
        found = by_component.get("" if component.id == "device" else component.id, [])
        if not found:
            continue
        stream = ET.SubElement(device, "ComponentStream", component=component.element, name=component.name, componentId=component.id)
        for category, element in CATEGORY.items():
            of_category = sorted((one for one in found if one.item.category == category), key=lambda one: one.sequence)
            if of_category:
                held = ET.SubElement(stream, element)
                for one in of_category:
                    _observation(held, one)
    return as_bytes(root)


def _observation(held: ET.Element, one: Observation) -> None:
    item = one.item
    given = {"dataItemId": item.id, "sequence": str(one.sequence), "timestamp": timestamp(one.at)}
    if item.category == "CONDITION":
        active = one.value
        given["type"] = item.type
        level = LEVEL[active.level] if isinstance(active, Active) else "Unavailable"
        node = ET.SubElement(held, level, given)
        if isinstance(active, Active) and active.code:
            node.set("nativeCode", legal(active.code))
            node.text = legal(active.text) or None
        return
    if item.sub_type:
        given["subType"] = item.sub_type
    node = ET.SubElement(held, item.element, given)
    node.text = UNAVAILABLE if one.value is None else legal(str(one.value))


def tool_assets(cell: Cell) -> dict[str, Tool]:
    """The cell's cutters by asset id."""
    return {f"{cell.name}-tool-{tool.number}": tool for tool in cell.tools if tool.kind != "deposition"}


def tool_element(cell: Cell, asset_id: str, at: float) -> ET.Element:
    """A cutter as CuttingTool asset: its nominal sizes in mm as the cell file has them."""
    tool = tool_assets(cell)[asset_id]
    node = ET.Element(
        "CuttingTool", assetId=asset_id, timestamp=timestamp(at), deviceUuid=uuid_of(cell), serialNumber=asset_id, toolId=str(tool.number)
    )
    life = ET.SubElement(node, "CuttingToolLifeCycle")
    ET.SubElement(ET.SubElement(life, "CutterStatus"), "Status").text = "AVAILABLE"
    ET.SubElement(life, "ProgramToolNumber").text = str(tool.number)
    measured = ET.SubElement(life, "Measurements")
    ET.SubElement(measured, "CuttingDiameterMax", units="MILLIMETER", code="DC").text = f"{tool.diameter_mm:g}"
    return node


def assets(mirror: Mirror, at: float, wanted: list[str]) -> bytes:
    """The answer to /asset. Raises KeyError for an id that there is not."""
    known = tool_assets(mirror.cell)
    root = _root("Assets", mirror, at, assetBufferSize=max(len(known), 1), assetCount=len(known))
    held = ET.SubElement(root, "Assets")
    for asset_id in wanted or known:
        held.append(tool_element(mirror.cell, asset_id, mirror.instance))
    return as_bytes(root)


def error(mirror: Mirror, at: float, code: str, text: str) -> bytes:
    """The answer to a request that cannot be met. code : of the standard, as OUT_OF_RANGE"""
    root = _root("Error", mirror, at, bufferSize=BUFFER)
    root[0].attrib.pop("deviceModelChangeTime")  # the one header without it
    ET.SubElement(ET.SubElement(root, "Errors"), "Error", errorCode=code).text = legal(text)
    return as_bytes(root)
