// Colours in OKLab (Björn Ottosson, 2020): ramps whose equal steps look equal, for spectrograms and differences.

const toLinear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
const toGamma = (c) => (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055);

/** sRGB (0…1 each) of an OKLab colour; parts outside 0…1 lie outside the gamut. */
export function fromOklab([lightness, a, b]) {
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ].map((c) => (c < 0 ? -toGamma(-c) : toGamma(c)));
}

/** OKLab of sRGB (0…1 each). */
export function toOklab(rgb) {
  const [r, g, b] = rgb.map(toLinear);
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

const inGamut = (rgb) => rgb.every((c) => c >= -1e-6 && c <= 1 + 1e-6);

/** OKLab of lightness, chroma and hue (degrees), the chroma lowered as far as the screen's gamut needs. */
function fitted(lightness, chroma, hue) {
  const angle = (hue * Math.PI) / 180;
  const at = (c) => [lightness, c * Math.cos(angle), c * Math.sin(angle)];
  if (inGamut(fromOklab(at(chroma)))) return at(chroma);
  let [low, high] = [0, chroma];
  for (let i = 0; i < 20; i++) {
    const middle = (low + high) / 2;
    if (inGamut(fromOklab(at(middle)))) low = middle;
    else high = middle;
  }
  return at(low);
}

const distance = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);

/** 256 colours along a path (0…1 -> OKLab), equally far apart in OKLab: Uint8Array of 256 × 3. */
function table(path) {
  const fine = Array.from({ length: 2049 }, (_, i) => path(i / 2048));
  const walked = [0];
  for (let i = 1; i < fine.length; i++) walked.push(walked[i - 1] + distance(fine[i - 1], fine[i]));
  const colours = new Uint8Array(256 * 3);
  for (let i = 0, j = 0; i < 256; i++) {
    const aim = (walked.at(-1) * i) / 255;
    while (j < walked.length - 2 && walked[j + 1] < aim) j++;
    const share = (aim - walked[j]) / (walked[j + 1] - walked[j] || 1);
    const lab = fine[j].map((value, k) => value + share * (fine[j + 1][k] - value));
    fromOklab(lab).forEach((c, k) => (colours[i * 3 + k] = Math.round(255 * Math.min(1, Math.max(0, c)))));
  }
  return colours;
}

const made = new Map();
const once = (name, path) => {
  if (!made.has(name)) made.set(name, table(path));
  return made.get(name);
};

/** Level, quiet to loud. On dark paper from nearly black to light yellow, on light paper from white to nearly black. */
export function levelRamp(dark) {
  // Cool where it is quiet, warm where it is loud; the chroma swells in the middle and is nothing at the paper's end.
  return dark
    ? once("level-dark", (t) =>
        fitted(0.16 + 0.8 * t, 0.21 * Math.sin(Math.PI * Math.min(1, 0.06 + 0.84 * t)), 255 + 205 * t),
      )
    : once("level-light", (t) => fitted(0.99 - 0.8 * t, 0.2 * Math.sin(Math.PI * (0.9 * t)), 95 - 170 * t));
}

/** Difference, less to more: blue, the paper, orange. */
export function differenceRamp(dark) {
  const paper = dark ? 0.2 : 0.985;
  const end = dark ? 0.82 : 0.45;
  return once(dark ? "difference-dark" : "difference-light", (t) => {
    const u = 2 * t - 1;
    return fitted(paper + (end - paper) * Math.abs(u), 0.2 * Math.abs(u), u < 0 ? 250 : 55);
  });
}

/** CSS colour of a ramp at 0…1. */
export function sample(ramp, share) {
  const i = 3 * Math.round(255 * Math.min(1, Math.max(0, share)));
  return `rgb(${ramp[i]} ${ramp[i + 1]} ${ramp[i + 2]})`;
}
