// Waveform, spectrogram, partials, contacts and cost.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

export function mount(element, { store, api }) {}
