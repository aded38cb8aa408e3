"use strict";
// The comparison viewer: two pictures of a scene, flipped, split or side by side under one zoom.

const view = { scene: 0, slots: [null, null], canvases: [null, null], images: [null, null], front: 0, mode: "flip", kind: "picture", exposure: 0, split: 0.5, zoom: 1, x: 0.5, y: 0.5 };
const ui = {};

const picturesOf = (scene) => data.pictures.map((p, i) => ({ ...p, i })).filter((p) => p.scene === data.scenes[scene].name);
const referenceOf = (scene) => picturesOf(scene).find((p) => p.row == null);

/// The embedded picture of one of a point's rows, or undefined.
function pictureOfPoint(point) {
  const index = data.pictures.findIndex((p) => p.row != null && point.rows.includes(p.row));
  return index < 0 ? undefined : index;
}

function pictureName(p) {
  if (p.row == null) return "reference (A + B)/2";
  const row = data.rows[p.row];
  return `${row.method}, ${row.budget}, ${number(row.cpu_s)} s CPU`;
}

/// Shows a picture as A beside the scene's reference, and goes there.
function openPicture(index) {
  if (index == null) return;
  const scene = data.scenes.findIndex((s) => s.name === data.pictures[index].scene);
  const same = scene === view.scene;
  view.scene = scene;
  const other = referenceOf(scene)?.i ?? index;
  view.slots = [index, same && view.slots[1] !== index ? view.slots[1] : other];
  view.front = 0;
  fillPickers();
  refresh();
  document.getElementById("viewer").scrollIntoView();
  ui.canvas.focus({ preventScroll: true });
}

/// At first: the last pictures of the first two methods, or one and the reference.
function firstPictures() {
  const pictures = picturesOf(view.scene);
  const reference = referenceOf(view.scene);
  const lasts = data.methods.map(([name]) => pictures.filter((p) => p.row != null && data.rows[p.row].method === name).sort((a, b) => data.rows[b.row].cpu_s - data.rows[a.row].cpu_s)[0]);
  const found = [...lasts.filter(Boolean), reference].filter(Boolean);
  view.slots = [found[0]?.i ?? null, (reference ?? found[1] ?? found[0])?.i ?? null];
}

function fillPickers() {
  ui.scene.value = view.scene;
  const pictures = picturesOf(view.scene).sort((a, b) => (a.row ?? -1) - (b.row ?? -1));
  const groups = new Map([["reference", []]]);
  for (const p of pictures) {
    const name = p.row == null ? "reference" : data.rows[p.row].method;
    groups.set(name, [...(groups.get(name) ?? []), p]);
  }
  ui.pickers.forEach((picker, slot) => {
    const options = [...groups].filter(([, list]) => list.length).map(([name, list]) => el("optgroup", { label: name }, list.map((p) => el("option", { value: p.i }, pictureName(p)))));
    picker.replaceChildren(...options);
    picker.value = view.slots[slot];
  });
}

let latest = 0;

/// Unpacks and develops what is to be seen, then draws.
async function refresh() {
  const turn = ++latest;
  const reference = referenceOf(view.scene);
  try {
    const base = reference ? await picture(reference.i) : null;
    const images = await Promise.all(view.slots.map((index) => (index == null ? null : picture(index))));
    if (turn !== latest) return;
    view.images = images;
    const fits = (image) => view.kind === "picture" || ((view.kind !== "flip" || image.flip) && base && base.width === image.width && base.height === image.height);
    view.canvases = images.map((image) => (image && fits(image) ? developed(image, base, view.kind, view.exposure) : null));
    const misfit = images.some((image) => image && !fits(image));
    ui.note.textContent = misfit ? "No map: the scene has no reference of this size." : reductionNote();
  } catch (error) {
    ui.note.textContent = `The pictures cannot be shown: ${error.message}. This needs a browser with DecompressionStream (2023 or later).`;
  }
  draw();
}

function reductionNote() {
  const p = data.pictures[view.slots[0]];
  if (!p || p.width === p.full_width) return "";
  return `Reduced for this page from ${p.full_width}×${p.full_height} to ${p.width}×${p.height} pixels by means over squares; all figures are of the full pictures.`;
}

/// Panes of the stage: which slot is drawn where, and the part of the stage that one picture is fitted to.
function panes(width, height) {
  if (view.mode === "side") {
    const half = width / 2;
    return [0, 1].map((slot) => ({ slot, left: slot * half, right: (slot + 1) * half, origin: slot * half, span: half }));
  }
  if (view.mode === "flip") return [{ slot: view.front, left: 0, right: width, origin: 0, span: width }];
  const cut = view.split * width;
  return [{ slot: 0, left: 0, right: cut, origin: 0, span: width }, { slot: 1, left: cut, right: width, origin: 0, span: width }];
}

/// Pixels of the stage for one pixel of the picture.
function magnification(span, height, image) {
  return Math.min(span / image.width, height / image.height) * view.zoom;
}

function draw() {
  const ratio = devicePixelRatio || 1;
  const width = ui.stage.clientWidth;
  const image = view.images.find(Boolean);
  if (!width || !image) return;
  const aspect = (image.height / image.width) * (view.mode === "side" ? 0.5 : 1);
  const height = Math.round(Math.min(width * aspect, Math.max(0.78 * innerHeight, 320)));
  ui.stage.style.height = `${height}px`;
  ui.canvas.width = Math.round(width * ratio);
  ui.canvas.height = Math.round(height * ratio);
  const context = ui.canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = "#0d0f12";
  context.fillRect(0, 0, width, height);
  for (const pane of panes(width, height)) {
    const canvas = view.canvases[pane.slot];
    if (!canvas) continue;
    context.save();
    context.beginPath();
    context.rect(pane.left, 0, pane.right - pane.left, height);
    context.clip();
    const scale = magnification(pane.span, height, image);
    const [w, h] = [image.width * scale, image.height * scale];
    context.imageSmoothingEnabled = scale * ratio < 1.5;
    context.imageSmoothingQuality = "high";
    context.drawImage(canvas, pane.origin + pane.span / 2 - view.x * w, height / 2 - view.y * h, w, h);
    context.restore();
  }
  if (view.mode !== "flip") {
    const cut = view.mode === "side" ? width / 2 : view.split * width;
    context.fillStyle = "#ffffff";
    context.fillRect(cut - 1, 0, 2, height);
    if (view.mode === "split") {
      context.beginPath();
      context.arc(cut, height - 26, 11, 0, 7);
      context.fill();
      context.fillStyle = "#14171c";
      context.font = "13px sans-serif";
      context.textAlign = "center";
      context.fillText("↔", cut, height - 21.5);
    }
  }
  tags();
}

function tags() {
  const name = (slot) => (view.slots[slot] == null ? "" : `${"AB"[slot]}  ${pictureName(data.pictures[view.slots[slot]])}`);
  const both = view.mode !== "flip";
  ui.tags[0].textContent = both ? name(0) : name(view.front);
  ui.tags[1].textContent = name(1);
  ui.tags[1].hidden = !both;
  ui.canvas.setAttribute("aria-label", `Comparison of ${name(0)} and ${name(1)}; ${both ? view.mode : "showing " + "AB"[view.front]}`);
  ui.zoom.textContent = `${number(view.zoom, 2)}×`;
  ui.exposure.nextSibling.textContent = `${view.exposure > 0 ? "+" : ""}${minus(view.exposure)} EV`;
  for (const [name, value] of [["mode", view.mode], ["kind", view.kind]]) for (const button of ui[name].children) button.setAttribute("aria-pressed", String(button.value === value));
  drawScale();
}

function drawScale() {
  ui.scale.hidden = view.kind === "picture";
  if (view.kind === "picture") return;
  const [scale, low, high] = view.kind === "difference"
    ? [SIGNED_SCALE, minus(`-${number(2 ** -view.exposure, 2)}`), `+${number(2 ** -view.exposure, 2)} luminance`]
    : view.kind === "flip" ? [MAGMA, "0", `${number(2 ** -view.exposure, 2)} FLIP`] : [ERROR_SCALE, "0.001", "1 relative error"];
  const [from, canvas, to] = ui.scale.children;
  from.textContent = low;
  to.textContent = high;
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    context.fillStyle = `rgb(${scaleColour(scale, x / (canvas.width - 1)).join(",")})`;
    context.fillRect(x, 0, 1, canvas.height);
  }
}

function flip() {
  if (view.mode !== "flip") view.mode = "flip";
  else view.front = 1 - view.front;
  draw();
}

/// Where on the picture (0 to 1) a place on the stage is.
function place(clientX, clientY) {
  const box = ui.canvas.getBoundingClientRect();
  const image = view.images.find(Boolean);
  const [px, py] = [clientX - box.left, clientY - box.top];
  const all = panes(box.width, box.height);
  const pane = all.find((p) => px >= p.left && px < p.right) ?? all[0];
  const scale = magnification(pane.span, box.height, image);
  const [dx, dy] = [(px - pane.origin - pane.span / 2) / (image.width * scale), (py - box.height / 2) / (image.height * scale)];
  return { x: view.x + dx, y: view.y + dy, dx, dy };
}

/// Zooms so that the place under the pointer stays there.
function zoomBy(factor, at = { dx: 0, dy: 0 }) {
  const zoom = Math.min(Math.max(view.zoom * factor, 0.5), 64);
  const change = 1 - view.zoom / zoom;
  view.x += at.dx * change;
  view.y += at.dy * change;
  view.zoom = zoom;
  keepInside();
}

function keepInside() {
  view.x = Math.min(Math.max(view.x, 0), 1);
  view.y = Math.min(Math.max(view.y, 0), 1);
  draw();
}

function fit() {
  Object.assign(view, { zoom: 1, x: 0.5, y: 0.5 });
  draw();
}

function showValues(clientX, clientY) {
  const image = view.images.find(Boolean);
  if (!image) return;
  const at = place(clientX, clientY);
  if (at.x < 0 || at.x >= 1 || at.y < 0 || at.y >= 1) return (ui.values.textContent = "");
  const reference = referenceOf(view.scene);
  const lines = view.images.map((shown, slot) => {
    if (!shown) return null;
    const [x, y] = [Math.floor(at.x * shown.width), Math.floor(at.y * shown.height)];
    const n = shown.width * shown.height;
    const rgb = [0, 1, 2].map((c) => number(HALF[shown.bits[c * n + y * shown.width + x]], 4).padStart(10));
    return `${"AB"[slot]} ${rgb.join(" ")}   ${pictureName(data.pictures[view.slots[slot]])}`;
  });
  const [x, y] = [Math.floor(at.x * image.width), Math.floor(at.y * image.height)];
  ui.values.textContent = [`column ${x}, row ${y}: linear red, green, blue${reference ? "" : " (no reference)"}`, ...lines.filter(Boolean)].join("\n");
}

/// Drag to pan, two fingers to zoom, the divider to swipe, a click to flip.
function pointers() {
  const down = new Map();
  let moved = 0;
  let dragsSplit = false;
  const canvas = ui.canvas;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, event);
    if (down.size === 1) moved = 0;
    const box = canvas.getBoundingClientRect();
    dragsSplit = view.mode === "split" && down.size === 1 && Math.abs(event.clientX - box.left - view.split * box.width) < 24;
  });
  canvas.addEventListener("pointermove", (event) => {
    showValues(event.clientX, event.clientY);
    const before = down.get(event.pointerId);
    if (!before || !view.images.find(Boolean)) return;
    const box = canvas.getBoundingClientRect();
    moved += Math.abs(event.clientX - before.clientX) + Math.abs(event.clientY - before.clientY);
    if (down.size === 2) {
      const other = [...down.values()].find((e) => e.pointerId !== event.pointerId);
      const distance = (e) => Math.hypot(e.clientX - other.clientX, e.clientY - other.clientY);
      zoomBy(distance(event) / Math.max(distance(before), 1), place((event.clientX + other.clientX) / 2, (event.clientY + other.clientY) / 2));
    } else if (dragsSplit) {
      view.split = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
      draw();
    } else {
      const [from, to] = [place(before.clientX, before.clientY), place(event.clientX, event.clientY)];
      view.x -= to.x - from.x;
      view.y -= to.y - from.y;
      keepInside();
    }
    down.set(event.pointerId, event);
  });
  const up = (event) => {
    if (down.delete(event.pointerId) && event.type === "pointerup" && moved < 6 && view.mode === "flip") flip();
  };
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, up);
  canvas.addEventListener("wheel", (event) => {
    // Only a picture that was chosen takes the wheel (or a pinch), so that the page scrolls past it.
    const isChosen = document.activeElement === canvas || event.ctrlKey;
    if (!isChosen || !view.images.find(Boolean)) return;
    event.preventDefault();
    zoomBy(Math.exp(-event.deltaY * 0.0016), place(event.clientX, event.clientY));
  }, { passive: false });
}

function keys(event) {
  const pan = 0.08 / view.zoom;
  const actions = {
    " ": flip, f: flip, ArrowLeft: () => (view.x -= pan), ArrowRight: () => (view.x += pan), ArrowUp: () => (view.y -= pan), ArrowDown: () => (view.y += pan),
    "+": () => zoomBy(1.25), "=": () => zoomBy(1.25), "-": () => zoomBy(0.8), 0: fit,
    "[": () => setExposure(view.exposure - 0.5), "]": () => setExposure(view.exposure + 0.5),
    "<": () => (view.split = Math.max(0, view.split - 0.05)), ">": () => (view.split = Math.min(1, view.split + 0.05)),
  };
  if (!actions[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  actions[event.key]();
  keepInside();
}

function setExposure(value) {
  view.exposure = Math.min(Math.max(value, -8), 8);
  ui.exposure.value = view.exposure;
  refresh();
}

function choice(label, options, pick) {
  const buttons = options.map(([value, text]) => el("button", { type: "button", value, onclick: () => pick(value) }, text));
  return el("span", { class: "choice", role: "group", "aria-label": label }, buttons);
}

function startViewer() {
  const root = document.getElementById("viewer");
  if (!data.pictures.length) return root.remove();
  view.scene = data.scenes.findIndex((s) => s.name === data.pictures[0].scene);
  const withPictures = data.scenes.map((s, i) => [s.name, i]).filter(([, i]) => picturesOf(i).length);
  ui.scene = el("select", { id: "view-scene", onchange: () => { view.scene = Number(ui.scene.value); firstPictures(); fillPickers(); fit(); refresh(); } }, withPictures.map(([name, i]) => el("option", { value: i }, name)));
  ui.pickers = [0, 1].map((slot) => el("select", { id: `view-${"ab"[slot]}`, onchange: (e) => { view.slots[slot] = Number(e.target.value); view.front = slot; refresh(); } }));
  ui.mode = choice("Arrangement", [["flip", "Flip"], ["split", "Swipe"], ["side", "Side by side"]], (mode) => { view.mode = mode; draw(); });
  ui.kind = choice("What is shown", [["picture", "Picture"], ["difference", "Difference"], ["relative", "Relative error"], ...(data.pictures.some((p) => p.has_flip) ? [["flip", "FLIP"]] : [])], (kind) => { view.kind = kind; refresh(); });
  ui.exposure = el("input", { type: "range", id: "exposure", min: -8, max: 8, step: 0.25, value: 0, oninput: () => setExposure(Number(ui.exposure.value)) });
  ui.zoom = el("span", {}, "1×");
  ui.canvas = el("canvas", { id: "stage", tabindex: 0, role: "img", onkeydown: keys });
  ui.tags = [el("span", { class: "tag a" }), el("span", { class: "tag b" })];
  ui.stage = el("div", { class: "stage" }, ui.canvas, ui.tags);
  ui.scale = el("div", { class: "scale" }, el("span"), el("canvas", { width: 192, height: 12 }), el("span"));
  ui.values = el("p", { class: "values", "aria-live": "off" });
  ui.note = el("p", { class: "keys" });
  const button = (text, title, press) => el("button", { type: "button", title, "aria-label": title, onclick: press }, text);
  const swap = () => { view.slots.reverse(); fillPickers(); refresh(); };
  root.append(
    el("h2", { id: "viewer-title" }, "Compare pictures"),
    el("div", { class: "bar" }, el("label", {}, el("span", {}, "Scene"), ui.scene), el("label", {}, el("span", {}, "A"), ui.pickers[0]), el("label", {}, el("span", {}, "B"), ui.pickers[1]), button("A ⇄ B", "Exchange A and B", swap)),
    el("div", { class: "bar" }, ui.mode, el("button", { type: "button", id: "flip", onclick: flip }, "Flip A/B"), ui.kind,
      el("label", {}, el("span", {}, "Exposure"), ui.exposure, el("output", { for: "exposure" })),
      el("span", { class: "zoom" }, "Zoom ", button("−", "Zoom out", () => zoomBy(0.8)), ui.zoom, button("+", "Zoom in", () => zoomBy(1.25)), button("Fit", "Fit to the frame", fit))),
    ui.stage, ui.scale, ui.values, ui.note,
    el("p", { class: "keys" }, el("kbd", {}, "space"), " or a click flips, ", el("kbd", {}, "+"), el("kbd", {}, "−"), el("kbd", {}, "0"), " or the wheel over a clicked picture zooms, arrows or a drag pan, ", el("kbd", {}, "["), el("kbd", {}, "]"), " exposure, ", el("kbd", {}, "<"), el("kbd", {}, ">"), " divider. Values are half floats: about three digits."),
  );
  pointers();
  window.addEventListener("resize", draw);
  firstPictures();
  fillPickers();
  refresh();
}
