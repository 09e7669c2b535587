// Open, save, save as, duplicate, import, export; recovery and changes on disk.
//
//   mount(element, {store, api}): fills the element and follows the store from then on.

export function mount(element, { store, api }) {}
