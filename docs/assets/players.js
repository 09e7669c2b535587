// One sound at a time: a player that starts stops the others.
document.addEventListener(
  "play",
  ({ target }) => document.querySelectorAll("audio").forEach((audio) => audio !== target && audio.pause()),
  true,
);
