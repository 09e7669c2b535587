// Instruments to be played on a page: each comes when its button is pressed.
document.addEventListener("click", async ({ target }) => {
  const place = target.closest?.(".live");
  if (!place || !target.closest("button")) return;
  const here = (name) => new URL(place.dataset.live + name, document.baseURI).href;
  if (location.protocol === "file:") {
    place.textContent = "Browsers load no instruments beside pages that are opened from a disk: ./tools/docs --serve serves this site.";
    return;
  }
  target.closest("button").disabled = true;
  const instrument = document.createElement("div");
  try {
    const { mountInstrument } = await import(here("jawari.js"));
    const files = ["jawari.wasm", "jawari-relaxed.wasm", place.dataset.bank, "jawari-worklet.js", "jawari.css"];
    const [wasm, relaxed, bank, worklet, style] = files.map(here);
    place.after(instrument);
    mountInstrument(instrument, { wasm, relaxed, bank, worklet, style });
    place.remove();
  } catch (error) {
    instrument.remove();
    place.textContent = `The instrument does not come: ${error.message}`;
  }
});
