/** What all canvases share: sharp pixels, the palette of the style sheet, layers that are drawn only when they change. */
let palette = new Map(), paints = 0;

/** Forget the colours read so far, after a change of theme. */
export function repaint() { palette = new Map(); paints += 1; }

/** A colour of the style sheet. */
export function color(name) {
  let found = palette.get(name);
  if (found === undefined) { found = getComputedStyle(document.documentElement).getPropertyValue(name).trim(); palette.set(name, found); }
  return found;
}

const sizes = new WeakMap(); // told by the browser after layout: asking for a size while drawing would force one
const watch = new ResizeObserver((entries) => { for (const { target, contentRect } of entries) sizes.set(target, [Math.round(contentRect.width), Math.round(contentRect.height)]); });

function sizeOf(canvas) {
  const known = sizes.get(canvas);
  if (known) return known;
  watch.observe(canvas);
  const found = [canvas.clientWidth, canvas.clientHeight];
  sizes.set(canvas, found);
  return found;
}

/** The canvas at device pixels; width and height in CSS pixels, 0 while it is not shown. */
export function fit(canvas, options) {
  const ratio = window.devicePixelRatio || 1, [width, height] = sizeOf(canvas);
  const w = Math.round(width * ratio), h = Math.round(height * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d", options);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, ratio };
}

/** A picture as large as its canvas, drawn anew only when what it shows has changed. */
export class Layer {
  constructor(opaque) { this.opaque = opaque; this.key = null; this.at = -Infinity; this.image = document.createElement("canvas"); }

  /**
   * A cleared context to draw the layer with, or null while the picture is still right.
   * @param key what it shows; compared by value @param rest_ms not oftener than this, but at once where `place` is another
   */
  begin(width, height, ratio, place, key, now, rest_ms) {
    const spot = `${width}|${height}|${ratio}|${paints}|${place}`, moved = spot !== this.spot;
    if (!moved && (key === this.key || now - this.at < rest_ms)) return null;
    Object.assign(this, { spot, key, at: now });
    const w = Math.round(width * ratio), h = Math.round(height * ratio), image = this.image;
    if (image.width !== w || image.height !== h) { image.width = w; image.height = h; }
    const context = image.getContext("2d", { alpha: !this.opaque });
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (!this.opaque) context.clearRect(0, 0, width, height);
    return context;
  }
}

/** Small pictures, each drawn once and then copied to whole device pixels: by far cheaper than paths. */
export class Sprites {
  constructor() { this.clear(""); }

  /** Forget them where they would look different. */
  keep(look) { if (`${look}|${paints}` !== this.look) this.clear(look); }

  clear(look) { this.look = `${look}|${paints}`; this.found = new Map(); }

  /** Put the sprite `name` with its middle at (x, y); `draw(context)` makes it about its origin, within `reach` pixels. */
  put(c, ratio, name, x, y, reach, draw) {
    let image = this.found.get(name);
    if (!image) {
      image = document.createElement("canvas");
      image.width = image.height = 2 * Math.ceil(reach * ratio);
      const context = image.getContext("2d"), middle = image.width / 2;
      context.setTransform(ratio, 0, 0, ratio, middle, middle);
      draw(context);
      this.found.set(name, image);
    }
    c.drawImage(image, Math.round(x * ratio - image.width / 2), Math.round(y * ratio - image.width / 2));
  }
}
