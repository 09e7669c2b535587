// Kinds of events (jawari.h).

export const NOTE_ON = 1;
export const NOTE_OFF = 2;
export const CONTROL = 3;
export const BEND = 4;
export const PROGRAM = 5;
export const PARAMETER = 6;
export const PRESSURE = 7;
export const TUNING = 9;
