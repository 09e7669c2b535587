// The piano keyboard of the dock: mouse, touch, computer keys, MIDI.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

export function mount(element, { store, api }) {}
