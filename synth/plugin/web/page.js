// The page of one instrument.

import { mountInstrument } from "./instrument.js";

const MEASURED_EVERY_MS = 500;

/**
 * @param {HTMLElement} place
 * @param {Parameters<typeof mountInstrument>[1]} assets
 */
export function openPage(place, assets) {
  const measure = new URLSearchParams(location.search).has("measure");
  const instrument = mountInstrument(place, { ...assets, measure });
  window.instrument = instrument;
  if (!measure) return;
  const figures = document.createElement("p");
  figures.className = "figures";
  place.after(figures);
  instrument.ready.then(() => setInterval(async () => (figures.textContent = await instrument.measured()), MEASURED_EVERY_MS));
}
