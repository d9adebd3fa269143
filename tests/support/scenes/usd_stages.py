"""Small USD stages, and a reader of them without a child process."""

from pathlib import Path

from PIL import Image
from pxr import Sdf, Usd, UsdGeom, UsdShade

from vlnpe.scene_repair.scan.dispatch import scan_of
from vlnpe.scene_repair.scan.record import Scan
from vlnpe.scene_repair.usd import read_stage as read_usd

SQUARE = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]


def read_here(path: Path) -> Scan:
    """Without the child process, which takes a second to start."""
    return scan_of(path, read_usd.read(path))


def new_stage(path: Path, up: str = "Z", metres: float = 1.0) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Root").GetPrim())
    return stage


def square(stage: Usd.Stage, path: str, points: object = SQUARE) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    return mesh


def save(stage: Usd.Stage) -> None:
    stage.GetRootLayer().Save()


def preview(
    stage: Usd.Stage, path: str, color: object = None, file: str = "", varname: str = "st"
) -> UsdShade.Material:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    port = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if color is not None:
        port.Set(color)
    if file:
        reader = UsdShade.Shader.Define(stage, f"{path}/Reader")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(varname)
        texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        port.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    material.CreateSurfaceOutput().ConnectToSource(
        shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    )
    return material


def bind(prim: Usd.Prim, material: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def home(folder: Path, suffix: str = "usda") -> Path:
    """A scene as GRScenes lays it out: models in folders, referenced and instanced, in cm."""
    (folder / "models" / "bed").mkdir(parents=True)
    (folder / "Textures").mkdir()
    Image.new("RGB", (8, 8), (10, 200, 30)).save(folder / "Textures" / "wood.png")
    model = new_stage(folder / "models" / "bed" / f"instance.{suffix}", metres=0.01)
    mesh = square(
        model, "/Root/Group/Component/mesh_0", [(100 * x, 100 * y, 50) for x, y, _ in SQUARE]
    )
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    bind(mesh.GetPrim(), preview(model, "/Root/Looks/Wood", file="../../Textures/wood.png"))
    save(model)
    stage = new_stage(folder / f"scene.{suffix}", metres=0.01)
    square(stage, "/Root/Meshes/Base/floor/model_0", [(300 * x, 300 * y, 0) for x, y, _ in SQUARE])
    for k in range(2):
        prim = stage.DefinePrim(f"/Root/Meshes/Furnitures/bed/model_6f12ab34cd56ef78_{k}", "Xform")
        child = stage.DefinePrim(prim.GetPath().AppendChild("Instance"), "Xform")
        reference = f"./models/bed/instance.{suffix}"
        if k:
            child.GetPayloads().AddPayload(reference)
        else:
            child.GetReferences().AddReference(reference)
        child.SetInstanceable(True)
        UsdGeom.XformCommonAPI(prim).SetTranslate((300.0 * k, 0, 0))
    save(stage)
    return folder / f"scene.{suffix}"
