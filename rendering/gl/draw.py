"""Offscreen drawing of a MuJoCo model through EGL: colours and exact depth in one pass."""

import atexit
import functools
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ...formats.core.arrays import F32, I64, U8
from ...formats.core.errors import InputError
from ..frame import RenderRequest

NEAR_M = 0.02
HIDDEN_GROUP = 5


def open_display() -> tuple[Any, Any]:
    """Return a context of MuJoCo's, made current, and PyOpenGL's functions for it."""
    from mujoco.egl import GLContext

    context = GLContext(64, 64)
    context.make_current()
    from OpenGL import GL

    return context, GL


@dataclass(frozen=True)
class DrawnView:
    """A camera's view for OpenGL.

    Attributes:
        near_m, far_m: nothing nearer or farther is drawn [m].
        cut_above_m: nothing above this world z is drawn, if the camera is above it.
    """

    request: RenderRequest
    near_m: float
    far_m: float
    cut_above_m: float = np.inf


class GlContext:
    """The OpenGL context of this process; see `gl_context`."""

    def __init__(self) -> None:
        """Open the context.

        Raises:
            InputError: EGL or a driver for it is missing; the message says which.
        """
        try:
            self._context, self.gl = open_display()
        except Exception as error:  # PyOpenGL raises its own, OSError, AttributeError, ImportError
            reason = str(error).strip().splitlines()
            raise InputError(
                f"renderer gl: no OpenGL context through EGL ({type(error).__name__}: "
                f"{reason[0] if reason else 'no device'}); install libegl1 and a driver "
                "(libgl1-mesa-dri draws in software), or use the renderer embree"
            ) from error
        atexit.register(self._context.free)  # before MuJoCo ends the display
        self.device = bytes(self.gl.glGetString(self.gl.GL_RENDERER) or b"").decode()

    def use(self) -> None:
        """Make the context current in this thread."""
        self._context.make_current()


@functools.cache
def gl_context() -> GlContext:
    """Return the one context of this process.

    There is only one because MuJoCo frees a model's resources in whichever context is current.

    Raises:
        InputError: EGL or a driver for it is missing; the message says which.
    """
    return GlContext()


class ModelDrawer:
    """Draws one model."""

    def __init__(self, context: GlContext, model: mujoco.MjModel):
        """Upload the model's meshes to OpenGL."""
        context.use()
        self._context = context
        self.model = model
        self.data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, self.data)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 1)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 1
        self._option.geomgroup[HIDDEN_GROUP] = 0
        self._free = mujoco.MjvCamera()
        self._pixels = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        self._pixels.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # depth as stored
        self._scene.flags[:] = 0  # no shadows, fog or reflections; both sides are drawn

    def upload(self, textures: list[list[U8]]) -> None:
        """Fill the model's textures with mip pyramids, with anisotropic filtering."""
        gl = self._context.gl
        self._context.use()
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        sharpest = gl.glGetFloatv(0x84FF)  # GL_MAX_TEXTURE_MAX_ANISOTROPY
        for k, levels in enumerate(textures):
            gl.glBindTexture(gl.GL_TEXTURE_2D, int(self._pixels.texture[k]))
            for level, image in enumerate(levels):
                height, width = image.shape[:2]
                gl.glTexImage2D(
                    gl.GL_TEXTURE_2D, level, gl.GL_RGB8, width, height, 0,
                    gl.GL_RGB, gl.GL_UNSIGNED_BYTE, np.ascontiguousarray(image),
                )  # fmt: skip
            for name, value in (
                (gl.GL_TEXTURE_MAX_LEVEL, len(levels) - 1),
                (gl.GL_TEXTURE_WRAP_S, gl.GL_REPEAT),
                (gl.GL_TEXTURE_WRAP_T, gl.GL_REPEAT),
                (gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR),
                (gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR_MIPMAP_LINEAR),
            ):
                gl.glTexParameteri(gl.GL_TEXTURE_2D, name, value)
            gl.glTexParameterf(gl.GL_TEXTURE_2D, 0x84FE, min(float(sharpest), 16.0))
        gl.glBindTexture(gl.GL_TEXTURE_2D, 0)

    def draw(self, view: DrawnView) -> tuple[U8, F32]:
        """Return colours (H, W, 3) uint8 sRGB and depth (H, W) float32 [m], 0 = nothing."""
        camera, near_m, far_m = view.request.camera, view.near_m, view.far_m
        rotation = view.request.rotation
        context, width, height = self._context, camera.width_px, camera.height_px
        context.use()
        if width > self._pixels.offWidth or height > self._pixels.offHeight:
            mujoco.mjr_resizeOffscreen(
                max(width, self._pixels.offWidth), max(height, self._pixels.offHeight), self._pixels
            )
        # Another model may have been drawn in between.
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._pixels)
        mujoco.mjv_updateScene(
            self.model, self.data, self._option, None, self._free,
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        half = near_m * 0.5 * height / camera.focal_px
        for eye in self._scene.camera:
            eye.pos = view.request.position
            eye.forward = rotation[:, 2]
            eye.up = -rotation[:, 1]
            eye.frustum_near, eye.frustum_far = near_m, far_m
            eye.frustum_bottom, eye.frustum_top = -half, half
            eye.frustum_center = eye.frustum_width = 0.0
        rgb = np.empty((height, width, 3), dtype=np.uint8)
        stored = np.empty((height, width), dtype=np.float32)
        window = mujoco.MjrRect(0, 0, width, height)
        with _Cut(context, view):
            mujoco.mjr_render(window, self._scene, self._pixels)
        mujoco.mjr_readPixels(rgb, stored, window, self._pixels)
        near, far = np.float32(near_m), np.float32(far_m)
        depth = near * far / (near + stored * (far - near))
        depth[stored <= 0.0] = 0.0
        return np.ascontiguousarray(rgb[::-1]), np.ascontiguousarray(depth[::-1])

    def geoms(self, view: DrawnView) -> I64:
        """Return the geom (H, W) that each pixel shows of the view drawn last, −1 = none."""
        width, height = view.request.camera.width_px, view.request.camera.height_px
        self._context.use()
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        window = mujoco.MjrRect(0, 0, width, height)
        with _Cut(self._context, view):
            mujoco.mjr_render(window, self._scene, self._pixels)
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        rgb = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(rgb, None, window, self._pixels)
        code = rgb[::-1].astype(np.int64) @ np.array([1, 256, 65536]) - 1
        geom_of = np.array([g.objid for g in self._scene.geoms[: self._scene.ngeom]] + [-1])
        return geom_of[np.where(code < self._scene.ngeom, code, -1)]


class _Cut:
    """Clips the scene above a height while it is entered."""

    def __init__(self, context: GlContext, view: DrawnView):
        self._gl = context.gl
        height, rotation = view.request.position[2], view.request.rotation
        self._active = bool(height > view.cut_above_m)
        down = -rotation[2]  # world down in the optical frame; OpenGL's y and z axes are opposite
        self._plane = [down[0], -down[1], -down[2], float(view.cut_above_m - height)]

    def __enter__(self) -> None:
        if self._active:
            gl = self._gl
            gl.glMatrixMode(gl.GL_MODELVIEW)
            gl.glPushMatrix()
            gl.glLoadIdentity()
            gl.glClipPlane(gl.GL_CLIP_PLANE0, self._plane)
            gl.glPopMatrix()
            gl.glEnable(gl.GL_CLIP_PLANE0)

    def __exit__(self, *_: object) -> None:
        if self._active:
            self._gl.glDisable(self._gl.GL_CLIP_PLANE0)
