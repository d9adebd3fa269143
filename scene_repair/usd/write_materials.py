"""Write materials of the USD scene: UsdPreviewSurface for rendering, friction for physics."""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdPhysics, UsdShade

from ...formats.scene.bundle import Material
from ..scan.record import srgb_to_linear

# What MuJoCo's level models use by default, too.
FRICTION = 0.8


def look(stage: Usd.Stage, path: str, material: Material) -> UsdShade.Material:
    """Write a material at `path`: base colour times texture, both as the bundle has them."""
    usd_material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    linear = srgb_to_linear(np.array(material.base_color))
    if material.texture is None:
        color.Set(Gf.Vec3f(*(float(v) for v in linear)))
    else:
        reader = UsdShade.Shader.Define(stage, f"{path}/Uv")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{material.texture}")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for wrap in ("wrapS", "wrapT"):
            texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        scale = texture.CreateInput("scale", Sdf.ValueTypeNames.Float4)
        scale.Set(Gf.Vec4f(*(float(v) for v in linear), 1.0))
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        color.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    usd_material.CreateSurfaceOutput().ConnectToSource(surface)
    return usd_material


def friction(stage: Usd.Stage, path: str) -> UsdShade.Material:
    """Write the physics material that all colliders share."""
    usd_material = UsdShade.Material.Define(stage, path)
    physics = UsdPhysics.MaterialAPI.Apply(usd_material.GetPrim())
    physics.CreateStaticFrictionAttr(FRICTION)
    physics.CreateDynamicFrictionAttr(FRICTION)
    physics.CreateRestitutionAttr(0.0)
    return usd_material
