// Phrases, output and the stream of sound.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

export function mount(element, { store, api }) {}
