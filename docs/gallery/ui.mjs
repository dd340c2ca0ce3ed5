// Elements, sliders, canvases.

/** An element with attributes and children. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child != null));
  return made;
}

export const short = (x) =>
  Number.isInteger(x) && Math.abs(x) < 1e6 ? String(x) : Number(x).toPrecision(3);

/** Sliders, choices and buttons in one row; `values` has their state. */
export class Controls {
  constructor(host, changed) {
    this.host = host;
    this.changed = changed;
    this.values = {};
  }

  /** A labelled slider; with `log` it moves by powers. */
  slider(name, label, { min, max, value, step, log = false }) {
    this.values[name] = value;
    const to = (x) => (log ? Math.log(x) : x);
    const from = (x) => (log ? Math.exp(x) : x);
    const shown = element("output", {}, short(value));
    const input = element("input", {
      type: "range",
      min: to(min),
      max: to(max),
      step: step ?? (to(max) - to(min)) / 200,
    });
    input.value = to(value);
    input.addEventListener("input", () => {
      this.values[name] = from(Number(input.value));
      shown.value = short(this.values[name]);
      this.changed();
    });
    this.host.append(element("label", { className: "control" }, label, input, shown));
  }

  choice(name, label, options, value = options[0]) {
    this.values[name] = value;
    const select = element("select", {}, ...options.map((o) => element("option", {}, o)));
    select.value = value;
    select.addEventListener("change", () => {
      this.values[name] = select.value;
      this.changed();
    });
    this.host.append(element("label", { className: "control" }, label, select));
  }

  button(label, action) {
    const made = element("button", { type: "button" }, label);
    made.addEventListener("click", action);
    this.host.append(made);
  }
}

/** A canvas of a size, described for those who do not see it. */
export function canvas(width, height, description) {
  return element("canvas", { width, height, role: "img", ariaLabel: description });
}

/** Colours of the page, so that drawings follow light and dark. */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const named = (name) => style.getPropertyValue(name).trim();
  return {
    paper: named("--paper"),
    ink: named("--ink"),
    faint: named("--line"),
    one: named("--one"),
    two: named("--two"),
    three: named("--three"),
  };
}

/** Notes that something was drawn, for the test. */
export function drawn(on) {
  on.dataset.drawn = Number(on.dataset.drawn ?? 0) + 1;
}

/** Puts linear colours, four numbers a pixel, on a canvas. */
export function show(on, pixels, width, height, exposure = 1) {
  const image = new ImageData(width, height);
  for (let i = 0; i < width * height; i++) {
    for (let c = 0; c < 3; c++) {
      const linear = Math.min(Math.max(pixels[4 * i + c] * exposure, 0), 1);
      image.data[4 * i + c] = 255 * linear ** (1 / 2.2);
    }
    image.data[4 * i + 3] = 255;
  }
  on.getContext("2d").putImageData(image, 0, 0);
  drawn(on);
}
