"use strict";
// Pictures: from packed half floats to pixels of a canvas, and maps of how far they are from the reference.

/// Values of all half floats by their 16 bits.
const HALF = Float32Array.from({ length: 65536 }, (_, bits) => {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
});

/// Below this relative error the map is black, above 1 white: the scale of `compare --diff`.
const ERROR_LOW = 1e-3;
const ERROR_SCALE = [[0, 0, 0], [70, 10, 110], [190, 40, 60], [245, 130, 20], [250, 220, 60], [255, 255, 255]];
const SIGNED_SCALE = [[33, 102, 222], [140, 180, 240], [245, 245, 245], [245, 165, 120], [200, 40, 20]];
/// The palette magma of van der Walt and Smith (2015), at steps of an eighth.
const MAGMA = [[0, 0, 4], [28, 16, 68], [79, 18, 123], [129, 37, 129], [181, 54, 122], [229, 80, 100], [251, 135, 97], [254, 194, 135], [252, 253, 191]];
const NAN_COLOUR = [255, 0, 255];

async function unpack(id) {
  const text = document.getElementById(id).textContent;
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/// Most pictures kept unpacked; the oldest goes first.
const KEPT = 12;
const unpacked = new Map();

/// A picture: { width, height, bits, flip }, the bits of all red values, then green, then blue; roots of FLIP as bytes, or null.
function picture(index) {
  if (!unpacked.has(index)) {
    unpacked.set(index, load(index));
    if (unpacked.size > KEPT) unpacked.delete(unpacked.keys().next().value);
  }
  return unpacked.get(index);
}

async function load(index) {
  const { width, height, has_flip: hasFlip } = data.pictures[index];
  const planes = await unpack(`picture-${index}`);
  const n = 3 * width * height;
  const bits = Uint16Array.from({ length: n }, (_, i) => (planes[i] << 8) | planes[n + i]);
  // The reference is no different from itself.
  const flip = hasFlip ? await unpack(`flip-${index}`) : data.pictures[index].row == null ? new Uint8Array(width * height) : null;
  return { width, height, bits, flip };
}

const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);

/// Bytes of the screen for all half floats: 2^exposure, the soft shoulder of the program's own PNGs, sRGB.
function toneTable(exposure) {
  const gain = 2 ** exposure;
  return Uint8Array.from(HALF, (value) => {
    const x = Math.max(value * gain, 0);
    return Math.round(255 * encode(x <= 0.5 ? x : 1 - 0.25 / x));
  });
}

function scaleColour(scale, position) {
  const at = Math.min(Math.max(position, 0), 1) * (scale.length - 1);
  const below = Math.min(Math.floor(at), scale.length - 2);
  return scale[below].map((v, c) => v + (at - below) * (scale[below + 1][c] - v));
}

/// Squares of the 5×5-pixel means of a picture, per channel, cut off at the border: what errors are relative to.
function localSquares(image) {
  if (image.squares) return image.squares;
  const { width, height, bits } = image;
  const n = width * height;
  const across = new Float32Array(3 * n);
  const squares = new Float32Array(3 * n);
  const mean = (from, to, start, stride, i, end) => {
    const [low, high] = [Math.max(i - 2, 0), Math.min(i + 2, end - 1)];
    let sum = 0;
    for (let j = low; j <= high; j++) sum += from(start + j * stride);
    to(sum / (high - low + 1));
  };
  for (let c = 0; c < 3; c++)
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++) mean((k) => HALF[bits[k]], (v) => (across[c * n + y * width + x] = v), c * n + y * width, 1, x, width);
  for (let c = 0; c < 3; c++)
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++) mean((k) => across[k], (v) => (squares[c * n + y * width + x] = v * v), c * n + x, width, y, height);
  return (image.squares = squares);
}

/// Colour of each pixel for a kind of map.
const MAPS = {
  picture: (image, reference, exposure) => {
    const table = toneTable(exposure);
    const n = image.width * image.height;
    return (i) => {
      const [r, g, b] = [image.bits[i], image.bits[n + i], image.bits[2 * n + i]];
      if (HALF[r] + HALF[g] + HALF[b] !== HALF[r] + HALF[g] + HALF[b]) return NAN_COLOUR;
      return [table[r], table[g], table[b]];
    };
  },
  // Luminance minus the reference's, from -1 (blue) to 1 (red) at exposure 0.
  difference: (image, reference, exposure) => {
    const n = image.width * image.height;
    const light = ({ bits }, i) => 0.2126 * HALF[bits[i]] + 0.7152 * HALF[bits[n + i]] + 0.0722 * HALF[bits[2 * n + i]];
    const colours = Array.from({ length: 513 }, (_, k) => scaleColour(SIGNED_SCALE, k / 512));
    const gain = 256 * 2 ** exposure;
    return (i) => {
      const difference = (light(image, i) - light(reference, i)) * gain;
      return Number.isNaN(difference) ? NAN_COLOUR : colours[Math.round(256 + Math.min(Math.max(difference, -256), 256))];
    };
  },
  // LDR-FLIP at 67 pixels per degree, from 0 (black) to 1 at exposure 0. Bytes are roots.
  flip: (image, reference, exposure) => {
    const colours = Array.from({ length: 256 }, (_, k) => scaleColour(MAGMA, (k / 255) ** 2 * 2 ** exposure));
    return (i) => (Number.isNaN(HALF[image.bits[i]]) ? NAN_COLOUR : colours[image.flip[i]]);
  },
  // Root of the channels' mean of (I − R)² / (S² + 0.01), S the reference's mean over 5×5 pixels.
  relative: (image, reference) => {
    const n = image.width * image.height;
    const squares = localSquares(reference);
    const colours = Array.from({ length: 513 }, (_, k) => scaleColour(ERROR_SCALE, k / 512));
    const decades = -Math.log10(ERROR_LOW);
    return (i) => {
      let sum = 0;
      for (let c = 0; c < 3; c++) {
        const k = c * n + i;
        sum += (HALF[image.bits[k]] - HALF[reference.bits[k]]) ** 2 / (squares[k] + 0.01);
      }
      const error = Math.sqrt(sum / 3);
      if (Number.isNaN(error)) return NAN_COLOUR;
      return colours[Math.round(512 * Math.min(Math.max(1 + Math.log10(Math.max(error, 1e-9)) / decades, 0), 1))];
    };
  },
};

/// A canvas with the picture, or a map of it.
function developed(image, reference, kind, exposure) {
  const canvas = el("canvas", { width: image.width, height: image.height });
  const context = canvas.getContext("2d");
  const pixels = context.createImageData(image.width, image.height);
  const colourOf = MAPS[kind](image, reference, exposure);
  for (let i = 0; i < image.width * image.height; i++) {
    const [r, g, b] = colourOf(i);
    pixels.data[4 * i] = r;
    pixels.data[4 * i + 1] = g;
    pixels.data[4 * i + 2] = b;
    pixels.data[4 * i + 3] = 255;
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}
