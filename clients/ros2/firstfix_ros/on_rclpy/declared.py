"""The parameters of a node, declared with their types, ranges and descriptions."""

from __future__ import annotations

import json
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from firstfix.errors import InvalidOption

from ..parameters import Declaration, Parameters

_TYPES = {bool: "bool", float: "double", str: "string"}  # as ROS 2 calls them


def declare(node: Node) -> Parameters:
    """Declare all parameters, and return their values. Those that cannot change are read-only.

    Raises:
        InvalidOption: a value is not of the parameter's type, or not allowed.
    """
    values: dict[str, Any] = {}
    for one in Parameters.declarations():
        try:
            values[one.name] = node.declare_parameter(one.name, one.default, _descriptor(one)).value
        except ParameterException as error:
            wants = f"a {_TYPES[type(one.default)]}, such as {json.dumps(one.default)}"
            raise InvalidOption(f"the parameter {one.name} is {wants}: {error}") from None
    return Parameters.checked(values)


def _descriptor(one: Declaration) -> ParameterDescriptor:
    made = ParameterDescriptor(description=one.description, read_only=not one.can_change)
    if one.limits is not None:
        made.floating_point_range = [FloatingPointRange(from_value=one.limits[0], to_value=one.limits[1])]
    return made
