"""Drawing a MuJoCo model off the screen through EGL: colours and exact depth in one pass."""

from __future__ import annotations

import atexit
import functools
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....formats.core.camera import CameraModel
from ....formats.core.errors import InputError

NEAR_M = 0.02
HIDDEN_GROUP = 5
F32 = NDArray[np.float32]


def open_display() -> tuple[Any, Any]:
    """A context of MuJoCo's, made current, and PyOpenGL's functions to use in it."""
    from mujoco.egl import GLContext

    context = GLContext(64, 64)
    context.make_current()
    from OpenGL import GL

    return context, GL


class GlContext:
    """The OpenGL context of this process; see `gl_context`."""

    def __init__(self) -> None:
        """Open it.

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
        """Let this thread draw with it."""
        self._context.make_current()


@functools.cache
def gl_context() -> GlContext:
    """The one context of this process.

    There is only one, since MuJoCo frees what a model took in whichever context is current.

    Raises:
        InputError: EGL or a driver for it is missing; the message says which.
    """
    return GlContext()


class ModelDrawer:
    """One model, ready to be drawn."""

    def __init__(self, context: GlContext, model: mujoco.MjModel):
        """Hand the model's meshes to OpenGL."""
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
        self._pixels.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # as it is stored
        self._cut = _Cut(context, np.zeros(3), np.eye(3), np.inf)
        self._scene.flags[:] = 0  # no shadows, fog, reflections; both sides are drawn

    def upload(self, textures: list[list[NDArray[np.uint8]]]) -> None:
        """Fill the model's textures with mip pyramids, filtered along flat angles too."""
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

    def draw(
        self,
        camera: CameraModel,
        position_m: NDArray[np.float64],
        rotation: NDArray[np.float64],
        near_m: float,
        far_m: float,
        cut_above_m: float,
    ) -> tuple[NDArray[np.uint8], F32]:
        """Colours (H, W, 3) uint8 sRGB and depth (H, W) float32 [m], 0 = nothing.

        Args:
            camera: intrinsics.
            position_m: (3,) optical centre.
            rotation: (3, 3) optical axes (columns x right, y down, z forward) in the world.
            near_m: nothing nearer is drawn.
            far_m: nothing farther is drawn.
            cut_above_m: nothing above this world z is drawn, if the camera is above it.
        """
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
            eye.pos = position_m
            eye.forward = rotation[:, 2]
            eye.up = -rotation[:, 1]
            eye.frustum_near, eye.frustum_far = near_m, far_m
            eye.frustum_bottom, eye.frustum_top = -half, half
            eye.frustum_center = eye.frustum_width = 0.0
        rgb = np.empty((height, width, 3), dtype=np.uint8)
        stored = np.empty((height, width), dtype=np.float32)
        view = mujoco.MjrRect(0, 0, width, height)
        self._cut = _Cut(context, position_m, rotation, cut_above_m)
        with self._cut:
            mujoco.mjr_render(view, self._scene, self._pixels)
        mujoco.mjr_readPixels(rgb, stored, view, self._pixels)
        near, far = np.float32(near_m), np.float32(far_m)
        depth = near * far / (near + stored * (far - near))
        depth[stored <= 0.0] = 0.0
        return np.ascontiguousarray(rgb[::-1]), np.ascontiguousarray(depth[::-1])

    def geoms(self, camera: CameraModel) -> NDArray[np.int64]:
        """Geom (H, W) seen by each pixel of the view that was drawn last, −1 = none."""
        self._context.use()
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        view = mujoco.MjrRect(0, 0, camera.width_px, camera.height_px)
        with self._cut:
            mujoco.mjr_render(view, self._scene, self._pixels)
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        rgb = np.empty((camera.height_px, camera.width_px, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(rgb, None, view, self._pixels)
        code = rgb[::-1].astype(np.int64) @ np.array([1, 256, 65536]) - 1
        known = np.array([g.objid for g in self._scene.geoms[: self._scene.ngeom]] + [-1])
        return known[np.where(code < self._scene.ngeom, code, -1)]


class _Cut:
    """Takes off what lies above a height, while it is entered."""

    def __init__(
        self,
        context: GlContext,
        position_m: NDArray[np.float64],
        rotation: NDArray[np.float64],
        cut_above_m: float,
    ):
        self._gl = context.gl
        self._wanted = bool(position_m[2] > cut_above_m)
        down = -rotation[2]  # world down in the optical frame; OpenGL's y and z point the other way
        self._plane = [down[0], -down[1], -down[2], float(cut_above_m - position_m[2])]

    def __enter__(self) -> None:
        if self._wanted:
            gl = self._gl
            gl.glMatrixMode(gl.GL_MODELVIEW)
            gl.glPushMatrix()
            gl.glLoadIdentity()
            gl.glClipPlane(gl.GL_CLIP_PLANE0, self._plane)
            gl.glPopMatrix()
            gl.glEnable(gl.GL_CLIP_PLANE0)

    def __exit__(self, *_: object) -> None:
        if self._wanted:
            self._gl.glDisable(self._gl.GL_CLIP_PLANE0)
