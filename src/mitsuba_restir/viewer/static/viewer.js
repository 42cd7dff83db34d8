// The picture, the camera and their websocket; all else in the page is NiceGUI's.
"use strict";

const viewer = (() => {
  const RETRY = 1000, GRAB = 14, FAST = 3, LONGEST_STEP = 0.1;
  const at = (id) => document.getElementById(id);
  const light = (name, on) =>
    document.querySelector(`.toolbar [data-control="${name}"]`)?.classList.toggle("on", on);
  const held = new Set();
  let socket = null, facts = null, bitmaps = [], divider = 0.5, mode = "orbit";
  let drag = null, pending = null, pictures = [], ticking = false, last = 0, fast = 1;

  // ------------------------------ connection --------------------------------------------------

  function connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    socket = new WebSocket(`${scheme}://${location.host}/stream`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => (typeof data === "string" ? note(JSON.parse(data)) : show(data));
    socket.onclose = () => {
      note({ status: "no connection", problem: "" });
      if (!document.hidden) setTimeout(connect, RETRY);
    };
  }

  // Nothing is rendered for a page that nobody sees.
  function watch() {
    if (document.hidden) socket.close();
    else if (socket.readyState === WebSocket.CLOSED) connect();
  }

  function send(message) {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }

  async function show(data) {
    const length = new DataView(data).getUint32(0, true);
    const next = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    let start = 4 + length;
    const parts = next.sizes.map((size) => {
      const part = new Blob([new Uint8Array(data, start, size)], { type: "image/jpeg" });
      start += size;
      return part;
    });
    const decoded = await Promise.all(parts.map((part) => createImageBitmap(part)));
    bitmaps.forEach((bitmap) => bitmap.close());
    bitmaps = decoded;
    facts = next;
    draw();
    send({ type: "seen", number: next.number });
    const now = performance.now();
    pictures = [...pictures.filter((time) => now - time < 2000), now];
    tell();
  }

  function note({ status, problem, leads, complaint }) {
    at("busy").hidden = !status;
    at("busy").lastChild.textContent =
      status + (status && status !== "no connection" ? " …" : "");
    at("problem").hidden = !problem;
    at("problem").textContent = problem || "";
    viewer.leads = leads;
    if (complaint) console.warn(complaint);
    tell();
  }

  // ------------------------------ picture -----------------------------------------------------

  function draw() {
    if (!facts) return;
    const canvas = at("picture"), context = canvas.getContext("2d");
    if (canvas.width !== facts.width || canvas.height !== facts.height) {
      [canvas.width, canvas.height] = [facts.width, facts.height];
    }
    context.drawImage(bitmaps[0], 0, 0);
    if (bitmaps[1]) {
      const x = Math.round(divider * facts.width), w = facts.width - x, h = facts.height;
      if (w > 0) context.drawImage(bitmaps[1], x, 0, w, h, x, 0, w, h);
    }
    place();
  }

  function place() {
    const stage = at("stage"), canvas = at("picture");
    const [width, height] = facts ? facts.full : [16, 9];
    const scale = Math.min(stage.clientWidth / width, stage.clientHeight / height);
    const w = width * scale, h = height * scale;
    const x = (stage.clientWidth - w) / 2, y = (stage.clientHeight - h) / 2;
    Object.assign(canvas.style, { left: `${x}px`, top: `${y}px`, width: `${w}px`, height: `${h}px` });
    // Pixels are looked at when all are there; fewer of them are a picture of the whole.
    canvas.style.imageRendering = facts && facts.width === width ? "pixelated" : "auto";
    const two = bitmaps.length > 1;
    for (const id of ["divider", "side-a", "side-b"]) at(id).hidden = !two;
    const line = x + divider * w;
    Object.assign(at("divider").style, { left: `${line}px`, top: `${y}px`, height: `${h}px` });
    Object.assign(at("side-a").style, { left: `${Math.max(line - 40, x + 4)}px`, top: `${y + 10}px` });
    Object.assign(at("side-b").style, { left: `${Math.min(line + 16, x + w - 30)}px`, top: `${y + 10}px` });
  }

  function tell() {
    if (!facts) return;
    const [width, height] = facts.full;
    const seconds = (pictures[pictures.length - 1] - pictures[0]) / 1000;
    const words = [`<b>${facts.state}</b>`, `${facts.width} × ${facts.height}`];
    if (facts.state === "still") {
      words.push(`${facts.frames} frames`);
      if (facts.error !== null) words.push(`error ${(100 * facts.error).toPrecision(2)} %`);
    } else {
      words.push(`${facts.ms} ms a frame`);
      if (pictures.length > 2 && facts.state !== "frozen") {
        words.push(`${((pictures.length - 1) / seconds).toFixed(0)} frames/s`);
      }
    }
    if (facts.relmse?.some((error) => error !== null)) {
      words.push(`relMSE ${facts.relmse.map((error) => error ?? "–").join(" | ")}`);
    }
    if (facts.compiled) words.push(`${facts.compiled} kernels compiled`);
    if (viewer.leads === false) words.push("another browser has the camera");
    at("facts").innerHTML = words.map((word) => `<span>${word}</span>`).join("");
    at("scale").textContent = [...new Set(facts.scales)].filter(Boolean).join(" | ");
    document.documentElement.dataset.number = facts.number;
    document.documentElement.dataset.state = facts.state;
    light("freeze", facts.state === "frozen");
  }

  // ------------------------------ mouse -------------------------------------------------------

  function down(event) {
    const canvas = at("picture");
    canvas.focus();
    const sideways = event.button !== 0 || event.shiftKey;
    drag = { x: event.clientX, y: event.clientY };
    drag.how = sideways ? "pan" : mode === "fly" ? "look" : "orbit";
    canvas.setPointerCapture(event.pointerId);
    event.preventDefault();
  }

  function move(event) {
    if (!drag) return;
    const height = at("picture").clientHeight || 1;
    pending = pending || { how: drag.how, dx: 0, dy: 0 };
    pending.dx += (event.clientX - drag.x) / height;
    pending.dy += (event.clientY - drag.y) / height;
    [drag.x, drag.y] = [event.clientX, event.clientY];
    tick();
  }

  function wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    send({ type: "dolly", amount: bounded(-0.0012 * lines * event.deltaY) });
  }

  function divide(event) {
    const box = at("picture").getBoundingClientRect();
    divider = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    draw();
  }

  const bounded = (value) => Math.min(Math.max(value, -4), 4);

  // ------------------------------ keys --------------------------------------------------------

  const ASKED = { " ": "freeze", ".": "step", Backspace: "reset", c: "compare" };
  const FLOWN = "wasdqe";

  function press(event) {
    const typed = event.target.closest("input, textarea, [role=listbox], [role=slider], [role=switch]");
    if (typed || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (FLOWN.includes(key)) {
      held.add(key);
      tick();
    } else if (event.repeat) {
      return;
    } else if (ASKED[key]) {
      emitEvent(`viewer_${ASKED[key]}`);
    } else if (key === "o" || key === "f") {
      viewer.mode(key === "o" ? "orbit" : "fly");
    } else if (key === "h") {
      viewer.home();
    } else if (key === "p") {
      viewer.screenshot();
    } else {
      return;
    }
    event.preventDefault();
  }

  function release(event) {
    held.delete(event.key.length === 1 ? event.key.toLowerCase() : event.key);
    if (event.key === "Shift") fast = 1;
  }

  const way = (plus, minus) => (held.has(plus) ? 1 : 0) - (held.has(minus) ? 1 : 0);

  // What has come together since the last frame of the browser's goes in one message.
  function tick() {
    if (ticking) return;
    ticking = true;
    last = performance.now();
    requestAnimationFrame(sent);
  }

  function sent(now) {
    if (pending) {
      send({ type: "drag", how: pending.how, dx: bounded(pending.dx), dy: bounded(pending.dy) });
      pending = null;
    }
    if (held.size) {
      const seconds = fast * Math.min(Math.max((now - last) / 1000, 0.001), LONGEST_STEP);
      const [right, up, forward] = [way("d", "a"), way("e", "q"), way("w", "s")];
      send({ type: "fly", right: right * seconds, up: up * seconds, forward: forward * seconds });
    }
    last = now;
    ticking = held.size > 0;
    if (ticking) requestAnimationFrame(sent);
  }

  // ------------------------------ beginning ---------------------------------------------------

  function begin() {
    const canvas = at("picture");
    if (!canvas) return requestAnimationFrame(begin);
    canvas.addEventListener("pointerdown", down);
    canvas.addEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, () => { drag = null; });
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", wheel, { passive: false });
    const line = at("divider");
    line.addEventListener("pointerdown", (event) => {
      line.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    line.addEventListener("pointermove", (event) => {
      if (line.hasPointerCapture(event.pointerId)) divide(event);
    });
    document.addEventListener("keydown", (event) => {
      fast = event.shiftKey ? FAST : 1;
      press(event);
    });
    document.addEventListener("keyup", release);
    window.addEventListener("blur", () => held.clear());
    new ResizeObserver(place).observe(at("stage"));
    document.addEventListener("visibilitychange", watch);
    viewer.mode("orbit");
    connect();
  }

  document.addEventListener("DOMContentLoaded", begin);

  return {
    leads: null,
    facts: () => facts,
    mode(name) {
      mode = name;
      for (const tool of ["orbit", "fly"]) light(tool, tool === name);
    },
    home: () => send({ type: "home" }),
    screenshot() {
      const link = document.createElement("a");
      link.href = `/screenshot.png?divider=${divider.toFixed(4)}`;
      link.download = "view.png";
      link.click();
    },
    fullscreen() {
      const stage = at("stage");
      if (document.fullscreenElement) document.exitFullscreen();
      else stage.requestFullscreen?.();
    },
    write(side, text) {
      const block = document.querySelector(`.command[data-side="${side}"]`);
      if (block) block.textContent = text;
      else requestAnimationFrame(() => viewer.write(side, text));
    },
    async copy() {
      const blocks = [...document.querySelectorAll(".command")];
      const text = blocks.map((block) => block.textContent).join("\n\n");
      // The clipboard is there on this machine and by https only; elsewhere there is the old way.
      if (navigator.clipboard) return navigator.clipboard.writeText(text);
      getSelection().selectAllChildren(blocks[0]);
      document.execCommand("copy");
    },
  };
})();
