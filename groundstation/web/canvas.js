/** What all canvases share: sharp pixels and the palette of the style sheet. */
let palette = new Map();

/** Forget the colours read so far, after a change of theme. */
export function repaint() { palette = new Map(); }

/** A colour of the style sheet. */
export function color(name) {
  if (!palette.has(name)) palette.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return palette.get(name);
}

/** The canvas at device pixels; width and height in CSS pixels. */
export function fit(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  const w = Math.round(width * ratio), h = Math.round(height * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}
