"use strict";
// Every picture is in the page once, as an <img> of a gallery; the comparison draws from these.
for (const section of document.querySelectorAll("section.size")) {
  const box = section.querySelector(".compare");
  if (!box) continue;
  const images = new Map();
  for (const image of section.querySelectorAll(".gallery.images img"))
    images.set(image.dataset.name, image);
  Promise.all([...images.values()].map((image) => image.decode())).then(() => start(box, images));
}

function start(box, images) {
  const [stage, under, over, handle, frame, crops] =
    [".stage", ".under", ".over", ".handle", ".frame", ".crops"].map((s) => box.querySelector(s));
  const [left, right] = [".left", ".right"].map((s) => box.querySelector(s));
  const first = images.values().next().value;
  const width = first.naturalWidth, height = first.naturalHeight;
  const state = { split: 0.5, x: width / 2, y: height / 2, side: Math.min(48, width, height) };

  function paint(canvas, name) {
    canvas.width = width;
    canvas.height = height;
    canvas.getContext("2d").drawImage(images.get(name), 0, 0);
  }

  function show() {
    const percent = 100 * state.split;
    over.style.clipPath = `inset(0 ${100 - percent}% 0 0)`;
    handle.style.left = `${percent}%`;
    handle.setAttribute("aria-valuenow", percent.toFixed(0));
  }

  const panes = new Map();
  for (const name of images.keys()) {
    const figure = document.createElement("figure");
    const canvas = document.createElement("canvas");
    const caption = document.createElement("figcaption");
    caption.textContent = name;
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
      context.drawImage(images.get(name), x, y, side, side, 0, 0, 4 * side, 4 * side);
    }
  }

  const place = (event) => {
    const edge = stage.getBoundingClientRect();
    return [(event.clientX - edge.left) / edge.width, (event.clientY - edge.top) / edge.height];
  };
  const split = (value) => { state.split = Math.min(Math.max(value, 0), 1); show(); };

  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    event.preventDefault();
    handle.focus();
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
  left.addEventListener("change", () => paint(over, left.value));
  right.addEventListener("change", () => paint(under, right.value));

  paint(over, left.value);
  paint(under, right.value);
  show();
  crop();
  box.dataset.ready = "yes";
}
