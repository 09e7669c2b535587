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
  const show = (text) => {
    figures.textContent = text;
    setTimeout(measured, MEASURED_EVERY_MS);
  };
  const measured = () => instrument.measured().then(show, () => figures.remove()); // it was closed, or never came
  measured();
}
