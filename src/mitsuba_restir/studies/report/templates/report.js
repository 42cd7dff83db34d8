"use strict";
// Every picture is in the page once, as an <img> of a gallery; the comparison draws from these.
for (const section of document.querySelectorAll("section.size")) {
  const box = section.querySelector(".compare");
  if (!box) continue;
  const layers = new Map();
  for (const gallery of section.querySelectorAll(".gallery[data-layer]")) {
    const images = new Map();
    for (const image of gallery.querySelectorAll("img")) images.set(image.dataset.name, image);
    layers.set(gallery.dataset.layer, images);
  }
  const all = [...layers.values()].flatMap((images) => [...images.values()]);
  Promise.all(all.map((image) => image.decode())).then(() => start(box, layers));
}

function start(box, layers) {
  const [stage, under, over, handle, frame, crops] =
    [".stage", ".under", ".over", ".handle", ".frame", ".crops"].map((s) => box.querySelector(s));
  const [left, right, layer] =
    [".left", ".right", ".layer"].map((s) => box.querySelector(`select${s}`));
  const base = layers.values().next().value;
  const first = base.values().next().value;
  const width = first.naturalWidth, height = first.naturalHeight;
  const state = { split: 0.5, x: width / 2, y: height / 2, side: Math.min(48, width, height) };

  // The reference has no errors: it is then shown as it is.
  const image = (name) => layers.get(layer.value).get(name) || base.get(name);

  function paint(canvas, name) {
    canvas.width = width;
    canvas.height = height;
    canvas.getContext("2d").drawImage(image(name), 0, 0);
  }

  function show() {
    const percent = 100 * state.split;
    over.style.clipPath = `inset(0 ${100 - percent}% 0 0)`;
    handle.style.left = `${percent}%`;
    handle.setAttribute("aria-valuenow", percent.toFixed(0));
  }

  const panes = new Map();
  for (const name of base.keys()) {
    const figure = document.createElement("figure");
    const canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    caption.textContent = name.replaceAll("_", "_\u200b");
    figure.append(canvas, caption);
    crops.append(figure);
    panes.set(name, canvas);
  }

  function crop() {
    const { side } = state;
    const x = Math.round(Math.min(Math.max(state.x - side / 2, 0), width - side));
    const y = Math.round(Math.min(Math.max(state.y - side / 2, 0), height - side));
    Object.assign(frame.style, {
      left: `${(100 * x) / width}%`, top: `${(100 * y) / height}%`,
      width: `${(100 * side) / width}%`, height: `${(100 * side) / height}%`,
    });
    for (const [name, canvas] of panes) {
      canvas.width = canvas.height = 4 * side;
      canvas.dataset.crop = `${x},${y},${side}`;
      const context = canvas.getContext("2d");
      context.imageSmoothingEnabled = false;
      context.drawImage(image(name), x, y, side, side, 0, 0, 4 * side, 4 * side);
    }
  }

  function draw() {
    paint(over, left.value);
    paint(under, right.value);
    crop();
  }

  const place = (event) => {
    const edge = stage.getBoundingClientRect();
    return [(event.clientX - edge.left) / edge.width, (event.clientY - edge.top) / edge.height];
  };
  const split = (value) => { state.split = Math.min(Math.max(value, 0), 1); show(); };

  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    event.preventDefault();
    handle.focus({ preventScroll: true });
  });
  handle.addEventListener("pointermove", (event) => {
    if (handle.hasPointerCapture(event.pointerId)) split(place(event)[0]);
  });
  handle.addEventListener("click", (event) => event.stopPropagation());
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -0.01, ArrowRight: 0.01, PageDown: -0.1, PageUp: 0.1 }[event.key];
    if (step) { split(state.split + step); event.preventDefault(); }
  });
  stage.addEventListener("click", (event) => {
    const [x, y] = place(event);
    Object.assign(state, { x: x * width, y: y * height });
    crop();
  });
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    const side = Math.round(state.side * (event.deltaY > 0 ? 1.25 : 0.8));
    state.side = Math.min(Math.max(side, 8), width, height);
    crop();
  }, { passive: false });
  for (const choice of [left, right, layer]) choice.addEventListener("change", draw);

  show();
  draw();
  box.dataset.ready = "yes";
}

// The table of all numbers keeps the quantities, or the variants of them, that are looked for.
for (const field of document.querySelectorAll("input.search")) {
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of document.querySelectorAll(".numbers tbody")) {
      const [head, ...rows] = group.rows;
      const title = head.textContent.toLowerCase();
      const left = words.filter((word) => !title.includes(word));
      for (const row of rows) {
        const text = row.cells[0].textContent.toLowerCase();
        row.hidden = !left.every((word) => text.includes(word));
      }
      group.hidden = rows.every((row) => row.hidden);
    }
  });
}
