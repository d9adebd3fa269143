"use strict";
// viser leaves sliders, numbers and symbols without a name for a screen reader: each gets the first
// words of the row that it stands in. So do the scene, the curves and the pictures.
const SYMBOLS = { "◀◀": "Event before", "◀": "Step back", "▶": "Step", "▶▶": "Next event" };
const NAMES = {
  "canvas[data-engine]": "The scene in three dimensions; the panel says what happens in it",
  ".uplot": "Curves of speed and tilt over time; the events are listed below",
  "img:not([alt])": "What the robot's camera sees",
};
setInterval(() => {
  for (const [place, name] of Object.entries(NAMES))
    for (const e of document.querySelectorAll(place)) [e.role, e.ariaLabel] = ["img", name];
  for (const e of document.querySelectorAll("svg, canvas:not([data-engine])")) e.ariaHidden = true;
  for (const e of document.querySelectorAll("[role=slider], input, button")) {
    e.ariaLabel ||= SYMBOLS[e.innerText?.trim()] ?? null;
    if (e.ariaLabel || e.labels?.length || (e.innerText || "").trim()) continue;
    let row = e;
    while (row && !/^\p{L}/u.test((row.innerText || "").trim())) row = row.parentElement;
    if (row) e.ariaLabel = row.innerText.trim().split("\n")[0].slice(0, 60);
  }
}, 1000);

// A processor that draws in place of a graphics card gets fewer pixels while something moves.
(() => {
  const LEAST = 0.3, STILL_MS = 500, WINDOW_MS = 1000, RATE = 30;
  const getContext = HTMLCanvasElement.prototype.getContext;
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const card = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software|basic render/i.test(card)) return;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    const cheap = { ...options, antialias: false, preserveDrawingBuffer: false };
    return getContext.call(this, kind, /^webgl/.test(kind) ? cheap : options);
  };
  let low = 0.5, moving = false, asked = 0, since = 0, frames = 0;
  const draw = dpr => {
    window.__viserTestpoints.devSettings.set({ fixedDpr: dpr });
    const nodes = window.__viserSceneTree.getState();
    for (const name of Object.keys(nodes).filter(name => name.endsWith("/coarse"))) {
      nodes[name].overrideVisibility = moving;
      Object.assign(nodes[name.replace("/coarse", "/fine")] ?? {}, { overrideVisibility: !moving });
    }
  };
  setInterval(() => {
    const viser = window.__viserMutable, now = performance.now();
    if (!viser || !window.__viserTestpoints) return;
    if (!viser.requestRender.counted) {
      const request = viser.requestRender;
      viser.requestRender = () => { asked = performance.now(); request(); };
      viser.requestRender.counted = true;
    }
    const drawn = window.__viserTestpoints.rendererInfo.render.frame;
    if (moving !== now - asked < STILL_MS) {
      moving = !moving;
      [since, frames] = [now, drawn];
      draw(moving ? low : null);
    } else if (moving && now - since > WINDOW_MS) {
      const rate = (drawn - frames) / (now - since) * 1000;
      [since, frames] = [now, drawn];
      if (rate < RATE && low > LEAST) draw(low = Math.max(LEAST, low * Math.max(0.7, rate / RATE)));
    }
  }, 100);
})();
