// Checks a .glb of `twopass solve --gltf`: Khronos' validator finds nothing wrong, and three.js draws it in headless Chromium.
//
//   node tests/page/gltf.mjs FILE.glb PACKAGES [SCREENSHOT.png]
//
// PACKAGES is a folder in which `npm install three gltf-validator` was run. Needs Node 18 or later and Chromium (another browser:
// CHROMIUM=/path/to/it). Exit code 1 if a check fails.

import { spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { extname, join, resolve } from "node:path";

const [file, packages, shot] = process.argv.slice(2);
if (!packages) {
  console.error("usage: node gltf.mjs FILE.glb PACKAGES [SCREENSHOT.png]");
  process.exit(2);
}
const bytes = readFileSync(file);
const fail = (what) => {
  console.error(`FAILED: ${what}`);
  process.exitCode = 1;
};

const validator = createRequire(resolve(packages, "package.json"))("gltf-validator");
const { issues, info } = await validator.validateBytes(new Uint8Array(bytes));
console.log(`validator: ${issues.numErrors} errors, ${issues.numWarnings} warnings, ${issues.numInfos} infos; ${info.totalTriangleCount} triangles`);
issues.messages.filter((m) => m.severity < 2).slice(0, 10).forEach((m) => console.log(`  ${m.code} ${m.pointer}: ${m.message}`));
if (issues.numErrors + issues.numWarnings > 0) fail("the validator complains");

// The page draws through the file's own camera, and tells how bright its pixels are.
const page = `<!doctype html><style>body{margin:0;background:#102040}</style>
<script type="importmap">{"imports":{"three":"/three/build/three.module.js","three/addons/":"/three/examples/jsm/"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
const tell = (what) => fetch("/told", { method: "POST", body: JSON.stringify(what) });
window.addEventListener("error", (e) => tell({ error: String(e.message) }));
try {
  const { scene, cameras } = await new GLTFLoader().loadAsync("/file.glb");
  const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
  renderer.setSize(innerWidth, innerHeight);
  document.body.append(renderer.domElement);
  const camera = cameras[0];
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  scene.updateMatrixWorld(true);
  renderer.render(scene, camera);
  const gl = renderer.getContext();
  const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const seen = new Set();
  let sum = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    sum += pixels[i] + pixels[i + 1] + pixels[i + 2];
    seen.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
  }
  await tell({ mean: sum / (3 * w * h), colours: seen.size, calls: renderer.info.render.calls, triangles: renderer.info.render.triangles });
} catch (e) {
  await tell({ error: String(e) });
}
</script>`;

const types = { ".js": "text/javascript", ".glb": "model/gltf-binary" };
let told;
const hasTold = new Promise((done) => (told = done));
const server = createServer((request, response) => {
  const path = new URL(request.url, "http://x").pathname;
  if (path === "/told") {
    let body = "";
    request.on("data", (part) => (body += part));
    request.on("end", () => {
      response.end();
      told(JSON.parse(body));
    });
    return;
  }
  try {
    const [type, content] = path === "/" ? ["text/html", page]
      : path === "/file.glb" ? [types[".glb"], bytes]
      : [types[extname(path)] ?? "text/plain", readFileSync(join(resolve(packages), "node_modules", path))];
    response.writeHead(200, { "content-type": type }).end(content);
  } catch {
    response.writeHead(404).end();
  }
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));

const profile = mkdtempSync(join(tmpdir(), "gltf-check-"));
const flags = [
  "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--hide-scrollbars", "--no-first-run",
  `--user-data-dir=${profile}`, "--window-size=800,800", "--virtual-time-budget=20000", `--screenshot=${resolve(shot ?? join(profile, "shot.png"))}`,
];
const browser = spawn(process.env.CHROMIUM ?? "chromium", [...flags, `http://127.0.0.1:${server.address().port}/`], { stdio: "ignore" });
browser.on("error", (error) => fail(`the browser does not start: ${error.message}`));
const ended = new Promise((done) => browser.on("exit", done));
const late = new Promise((done) => setTimeout(() => done({ error: "nothing drawn within two minutes" }), 120_000).unref());
const result = await Promise.race([hasTold, late]);
await Promise.race([ended, late]);
console.log(`three.js: ${JSON.stringify(result)}`);
if (result.error) fail(result.error);
else if (!(result.mean > 5 && result.colours > 50)) fail("the picture is dark or flat");
browser.kill();
server.close();
rmSync(profile, { recursive: true, force: true, maxRetries: 3 });
