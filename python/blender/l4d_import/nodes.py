# SPDX-License-Identifier: Apache-2.0
"""How Gaussians are drawn: geometry nodes that put an ellipsoid at each, and the materials of these."""

import bpy

NODES = "4D Gaussian splats"
ELLIPSOIDS, POINTS = "Gaussian ellipsoids", "Gaussian points"
EXTENT = 3.2
"""Standard deviations at which an ellipsoid ends: opacity is below 1 % of that of its middle there."""


class Builder:
    """Adds nodes to a tree and links them."""

    def __init__(self, tree):
        self.tree, self.column = tree, 0

    def add(self, kind, inputs=None, **settings):
        """Adds a node. inputs: by name or number, a value, or the socket of another node."""
        node = self.tree.nodes.new(kind)
        self.column += 1
        node.location = (200 * self.column, -60 * (self.column % 5))
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[name])
            else:
                node.inputs[name].default_value = value
        return node

    def math(self, operation, *values):
        node = self.add("ShaderNodeMath", dict(enumerate(values)), operation=operation)
        return node.outputs[0]

    def vector(self, operation, *values):
        node = self.add("ShaderNodeVectorMath", dict(enumerate(values)), operation=operation)
        return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]


def ellipsoid_material():
    """Light of the Gaussian's colour, as opaque as the Gaussian is at most along the ray."""
    material, build, output = _material(ELLIPSOIDS)
    # In the space of the ellipsoid the Gaussian is round and has size 1. A ray from p in the direction v passes its
    # middle at the square distance |p|^2 - (p.v)^2, wherever p is on the ray.
    place = build.add("ShaderNodeTexCoord").outputs["Object"]
    geometry = build.add("ShaderNodeNewGeometry")
    ray = build.add("ShaderNodeVectorTransform", {"Vector": geometry.outputs["Incoming"]}, vector_type="VECTOR",
                    convert_from="WORLD", convert_to="OBJECT").outputs[0]
    along = build.vector("DOT_PRODUCT", place, build.vector("NORMALIZE", ray))
    square = build.math("SUBTRACT", build.vector("DOT_PRODUCT", place, place), build.math("MULTIPLY", along, along))
    falloff = build.math("EXPONENT", build.math("MULTIPLY", square, -0.5))
    # A ray meets an ellipsoid twice; it counts where it enters.
    front = build.math("SUBTRACT", 1.0, geometry.outputs["Backfacing"])
    opacity = build.add("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name="opacity").outputs["Fac"]
    alpha = build.math("MULTIPLY", front, build.math("MULTIPLY", opacity, falloff))
    color = build.add("ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name="color").outputs["Color"]
    _shine(build, output, color, alpha)
    return material


def point_material():
    """The colour alone, for the viewport."""
    material, build, output = _material(POINTS)
    color = build.add("ShaderNodeAttribute", attribute_type="GEOMETRY", attribute_name="color").outputs["Color"]
    _shine(build, output, color, 1.0)
    return material


def _material(name):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    if hasattr(material, "blend_method"):  # Eevee of before Blender 4.2
        material.blend_method, material.shadow_method = "HASHED", "NONE"
    material.node_tree.nodes.clear()
    build = Builder(material.node_tree)
    return material, build, build.add("ShaderNodeOutputMaterial")


def _shine(build, output, color, alpha):
    light = build.add("ShaderNodeEmission", {"Color": color}).outputs[0]
    clear = build.add("ShaderNodeBsdfTransparent").outputs[0]
    mix = build.add("ShaderNodeMixShader", {0: alpha, 1: clear, 2: light})
    build.tree.links.new(mix.outputs[0], output.inputs["Surface"])


def splat_nodes():
    """The node group of the modifier, which is made once in a file."""
    if NODES in bpy.data.node_groups:
        return bpy.data.node_groups[NODES]
    tree = bpy.data.node_groups.new(NODES, "GeometryNodeTree")
    _socket(tree, "Geometry", "NodeSocketGeometry", "INPUT")
    extent = _socket(tree, "Extent", "NodeSocketFloat", "INPUT")
    extent.default_value, extent.min_value, extent.description = EXTENT, 0.1, "Size, in standard deviations"
    shown = _socket(tree, "Ellipsoids in Viewport", "NodeSocketBool", "INPUT")
    shown.default_value, shown.description = False, "Else the viewport has a point for each Gaussian"
    _socket(tree, "Geometry", "NodeSocketGeometry", "OUTPUT")

    build = Builder(tree)
    given, result = build.add("NodeGroupInput"), build.add("NodeGroupOutput")
    ball = build.add("GeometryNodeMeshIcoSphere", {"Radius": given.outputs["Extent"], "Subdivisions": 2})
    ball = build.add("GeometryNodeSetMaterial", {"Geometry": ball.outputs["Mesh"], "Material": ellipsoid_material()})
    ellipsoids = build.add("GeometryNodeInstanceOnPoints", {
        "Points": given.outputs["Geometry"], "Instance": ball.outputs["Geometry"],
        "Rotation": _attribute(build, "rotation"), "Scale": _attribute(build, "scale")})
    length = build.add("ShaderNodeVectorMath", {0: _attribute(build, "scale")}, operation="LENGTH").outputs["Value"]
    points = build.add("GeometryNodeMeshToPoints", {"Mesh": given.outputs["Geometry"], "Radius": length})
    points = build.add("GeometryNodeSetMaterial", {"Geometry": points.outputs[0], "Material": point_material()})
    # Points where it is the viewport that asks and ellipsoids are not wanted there.
    few = build.add("FunctionNodeBooleanMath", {0: given.outputs["Ellipsoids in Viewport"]}, operation="NOT")
    few = build.add("FunctionNodeBooleanMath", {0: build.add("GeometryNodeIsViewport").outputs[0],
                                                1: few.outputs[0]}, operation="AND")
    switch = build.add("GeometryNodeSwitch", input_type="GEOMETRY")
    # A node of 3.4 has sockets of each type.
    condition = next(socket for socket in switch.inputs if socket.name == "Switch" and socket.enabled
                     and (socket.identifier.endswith("_001") or len(switch.inputs) == 3))
    no, yes = (next(socket for socket in switch.inputs if socket.name == name and socket.type == "GEOMETRY")
               for name in ("False", "True"))
    out = next(socket for socket in switch.outputs if socket.type == "GEOMETRY")
    for source, target in ((few.outputs[0], condition), (ellipsoids.outputs[0], no), (points.outputs[0], yes),
                           (out, result.inputs[0])):
        tree.links.new(source, target)
    return tree


def _attribute(build, name):
    node = build.add("GeometryNodeInputNamedAttribute", {"Name": name}, data_type="FLOAT_VECTOR")
    return next(socket for socket in node.outputs if socket.type == "VECTOR")


def _socket(tree, name, kind, direction):
    if hasattr(tree, "interface"):  # Blender 4 and later
        return tree.interface.new_socket(name=name, in_out=direction, socket_type=kind)
    return (tree.inputs if direction == "INPUT" else tree.outputs).new(kind, name)
