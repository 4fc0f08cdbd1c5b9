// Theme of the page: greys for indoors, black on white for sunlight, or dark for the night; themes.css has the colours of each.

import { store, stored } from "./storage.js";

const STORAGE_KEY = "panel-theme";
export const THEMES = ["grey", "day", "night"];
const contrast = window.matchMedia("(prefers-contrast: more)");
let chosen = null; // by the user of this page

/** Return the theme: the user's choice, else that of the computer's contrast setting. */
export function theme() {
  return [chosen, stored(STORAGE_KEY)].find((name) => THEMES.includes(name)) ?? (contrast.matches ? "day" : "grey");
}

function show() {
  document.documentElement.dataset.theme = theme();
}

/** Show and store the user's choice. */
export function chooseTheme(name) {
  chosen = name;
  store(STORAGE_KEY, name);
  show();
}

contrast.addEventListener("change", show);
show(); // before the first texts, so that the page never flashes in the other theme
