// Opens a page of an experiment in headless Chromium, works its controls and takes screenshots to be looked at.
//
//   node tests/page/check.mjs DIR/index.html [FOLDER FOR SCREENSHOTS]
//
// Needs Node 18 or later and Chromium (Debian: `apt-get install chromium`; another browser: CHROMIUM=/path/to/it). It speaks
// the browser's own protocol through a pipe, so no package is installed. Exit code 1 if a check fails.

import { spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [page, shots] = process.argv.slice(2);
if (!page) {
  console.error("usage: node check.mjs DIR/index.html [FOLDER]");
  process.exit(2);
}
if (shots) mkdirSync(shots, { recursive: true });

const profile = mkdtempSync(join(tmpdir(), "page-check-"));
const flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run", `--user-data-dir=${profile}`, "--remote-debugging-pipe"];
const browser = spawn(process.env.CHROMIUM ?? "chromium", flags, { stdio: ["ignore", "ignore", "ignore", "pipe", "pipe"] });
browser.on("error", (error) => {
  console.error(`the browser does not start: ${error.message}`);
  process.exit(1);
});

// Messages are JSON, each ended by a zero byte.
let next = 1;
let session;
let buffer = "";
const waiting = new Map();
const requests = [];
const complaints = [];
browser.stdio[4].setEncoding("utf8").on("data", (text) => {
  const parts = (buffer + text).split("\0");
  buffer = parts.pop();
  for (const part of parts) receive(JSON.parse(part));
});
function receive(message) {
  if (message.id) {
    const { done, failed } = waiting.get(message.id);
    waiting.delete(message.id);
    return message.error ? failed(new Error(message.error.message)) : done(message.result);
  }
  if (message.method === "Network.requestWillBeSent") requests.push(message.params.request.url);
  if (message.method === "Runtime.exceptionThrown") complaints.push(message.params.exceptionDetails.exception?.description ?? message.params.exceptionDetails.text);
  if (message.method === "Log.entryAdded" && message.params.entry.level === "error") complaints.push(message.params.entry.text);
}
function send(method, params = {}) {
  const id = next++;
  browser.stdio[3].write(JSON.stringify({ id, method, params, ...(session ? { sessionId: session } : {}) }) + "\0");
  return new Promise((done, failed) => waiting.set(id, { done, failed }));
}
async function evaluate(expression) {
  const { result, exceptionDetails } = await send("Runtime.evaluate", { expression, awaitPromise: true, returnByValue: true });
  if (exceptionDetails) throw new Error(`${expression}: ${exceptionDetails.exception?.description}`);
  return result.value;
}
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function open(width, height, scheme, media = "") {
  await send("Emulation.setDeviceMetricsOverride", { width, height, deviceScaleFactor: 1, mobile: width < 500 });
  await send("Emulation.setEmulatedMedia", { media, features: [{ name: "prefers-color-scheme", value: scheme }] });
  await send("Page.navigate", { url: pathToFileURL(resolve(page)).href });
  await until("document.readyState === 'complete' && (!document.getElementById('stage') || view.canvases.some(Boolean))");
}
async function until(expression) {
  for (let i = 0; i < 200; i++) {
    if (await evaluate(`Boolean(${expression})`).catch(() => false)) return;
    await pause(100);
  }
  throw new Error(`waited in vain for ${expression}`);
}
async function shot(name, selector) {
  if (!shots) return;
  const box = await evaluate(`(() => { const b = ${selector ? `document.querySelector('${selector}')` : "document.documentElement"}.getBoundingClientRect(); return { x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height }; })()`);
  const { data } = await send("Page.captureScreenshot", { captureBeyondViewport: true, clip: { ...box, scale: 1 } });
  writeFileSync(join(shots, `${name}.png`), Buffer.from(data, "base64"));
}

let failures = 0;
function check(name, holds, detail = "") {
  if (!holds) failures++;
  console.log(`${holds ? "ok  " : "FAIL"} ${name}${detail === "" ? "" : `: ${detail}`}`);
}
const press = (selector) => evaluate(`document.querySelector('${selector}').click()`);
const stage = () => evaluate("document.getElementById('stage').toDataURL()");

async function checks() {
  await open(1280, 900, "light");
  const plots = await evaluate("[...document.querySelectorAll('.plot svg')].map((s) => [s.querySelectorAll('.curve').length, s.querySelectorAll('.tick').length])");
  check("every scene has a plot with curves and ticks", plots.length > 0 && plots.every(([curves, ticks]) => curves > 0 && ticks >= 4), JSON.stringify(plots));
  check("tables have rows", (await evaluate("document.querySelectorAll('.figures tbody tr').length")) > 0);
  const overlaps = await evaluate(`[...document.querySelectorAll('.plot svg')].flatMap((s) => {
    const boxes = [...s.querySelectorAll('text')].map((t) => t.getBoundingClientRect());
    return boxes.flatMap((a, i) => boxes.slice(i + 1).filter((b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 3 && b.top < a.bottom - 3));
  }).length`);
  check("no text of a plot covers another", overlaps === 0, overlaps);
  const before = await evaluate("document.querySelector('.plot svg').innerHTML");
  await press(".legend button");
  check("the legend hides a method", (await evaluate("document.querySelector('.plot svg')?.innerHTML")) !== before);
  await press(".legend button");
  // Parts can be left out of CPU time alone; a plan may begin with another clock.
  await evaluate("(() => { const clock = document.getElementById('clock'); clock.value = 'cpu'; clock.dispatchEvent(new Event('change')); })()");
  await evaluate("document.getElementById('count-pass-one').click()");
  check("the clock changes the plot", (await evaluate("document.querySelector('.plot svg').innerHTML")) !== before);
  await evaluate("document.getElementById('count-pass-one').click()");
  await evaluate("document.querySelector('.plot svg').focus()");
  await send("Input.dispatchKeyEvent", { type: "keyDown", key: "ArrowRight", code: "ArrowRight" });
  check("a point tells its row by keyboard", await evaluate("!document.getElementById('tip').hidden && document.getElementById('tip').textContent.includes('budget')"));
  await shot("tip", "body");
  await evaluate("document.activeElement.blur()");
  if (await evaluate("Boolean(document.getElementById('stage'))")) await viewer();
  else console.log("     no pictures, so no viewer");

  await open(1280, 900, "light");
  await shot("light");
  await open(1280, 900, "dark");
  await shot("dark");
  await open(390, 844, "light");
  const wide = await evaluate("document.documentElement.scrollWidth - innerWidth");
  check("a narrow page does not scroll sideways", wide <= 0, wide);
  await shot("narrow");
  await open(760, 1075, "dark", "print");
  check("paper is white and has no viewer", await evaluate("getComputedStyle(document.body).backgroundColor === 'rgb(255, 255, 255)' && getComputedStyle(document.getElementById('about')).display !== 'none' && !document.getElementById('viewer')?.offsetHeight"));
  await shot("print");
  if (shots) {
    const { data } = await send("Page.printToPDF", { printBackground: true, preferCSSPageSize: true });
    writeFileSync(join(shots, "print.pdf"), Buffer.from(data, "base64"));
  }
  const outside = requests.filter((url) => !url.startsWith("file:") && !url.startsWith("data:") && !url.startsWith("blob:"));
  check("nothing is fetched", outside.length === 0 && new Set(requests).size === 1, outside.join(" "));
  check("the console is silent", complaints.length === 0, complaints.join("; "));
}

async function viewer() {
  await evaluate("document.getElementById('viewer').scrollIntoView({ behavior: 'instant' })");
  const first = await stage();
  const box = await evaluate("(() => { const b = document.getElementById('stage').getBoundingClientRect(); return { x: b.x + b.width / 2, y: b.y + Math.min(b.height, innerHeight - b.y) / 2 }; })()");
  const mouse = (type, dx = 0, dy = 0, more = {}) => send("Input.dispatchMouseEvent", { type, x: box.x + dx, y: box.y + dy, button: "left", clickCount: 1, ...more });
  await mouse("mousePressed");
  await mouse("mouseReleased");
  const flipped = await stage();
  check("a click on the picture flips it", flipped !== first);
  await press("#flip");
  check("the button flips back", (await stage()) === first);
  await mouse("mouseMoved", 3, 3, { button: "none" });
  check("the values under the pointer are shown for both", await evaluate("/^A [^]*^B /m.test(document.querySelector('.values').textContent)"));
  await shot("viewer", "#viewer");
  await mouse("mouseWheel", 0, 0, { deltaX: 0, deltaY: -600, button: "none" });
  await pause(200);
  const zoomed = await stage();
  check("the wheel zooms", zoomed !== first && (await evaluate("view.zoom")) > 2);
  await mouse("mousePressed");
  await mouse("mouseMoved", 60, 40, { buttons: 1 });
  await mouse("mouseReleased", 60, 40);
  check("a drag pans and does not flip", (await stage()) !== zoomed && (await evaluate("view.front")) === 0);
  await press(".choice button[value=side]");
  await shot("side", "#viewer");
  await press(".choice button[value=split]");
  await shot("swipe", "#viewer");
  for (const kind of ["difference", "relative", ...((await evaluate("data.pictures.some((p) => p.has_flip)")) ? ["flip"] : [])]) {
    const last = await stage();
    await press(`.choice[aria-label="What is shown"] button[value=${kind}]`);
    await pause(1500);
    check(`the map "${kind}" is another picture`, (await stage()) !== last && (await evaluate("view.kind")) === kind);
    await shot(kind, "#viewer");
  }
  await press(".choice button[value=picture]");
  await pause(1000);
  const plain = await stage();
  await evaluate("(() => { const e = document.getElementById('exposure'); e.value = 2; e.dispatchEvent(new Event('input')); })()");
  await pause(1000);
  check("exposure brightens", (await stage()) !== plain);
}

let code = 1;
try {
  const { targetId } = await send("Target.createTarget", { url: "about:blank" });
  session = (await send("Target.attachToTarget", { targetId, flatten: true })).sessionId;
  for (const domain of ["Page", "Runtime", "Network", "Log"]) await send(`${domain}.enable`);
  await checks();
  code = failures ? 1 : 0;
} catch (error) {
  console.error(error.message);
}
browser.on("exit", () => {
  rmSync(profile, { recursive: true, force: true, maxRetries: 5, retryDelay: 200 });
  process.exit(code);
});
browser.kill();
