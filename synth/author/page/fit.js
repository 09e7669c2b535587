// Fitting the preset to a recording.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

export function mount(element, { store, api }) {}
