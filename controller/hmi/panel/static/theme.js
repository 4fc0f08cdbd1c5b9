// Theme of the page: greys for indoors, or black on white for sunlight; panel.css has the colours of each.

const STORAGE_KEY = "panel-theme";
export const THEMES = ["grey", "day"];
const contrast = window.matchMedia("(prefers-contrast: more)");
let chosen = null; // by the user of this page

function storedTheme() {
  try {
    return window.localStorage.getItem(STORAGE_KEY);
  } catch {
    return null; // storage is blocked: the selection is lost when the page closes
  }
}

/** Return the theme: the user's choice, else that of the computer's contrast setting. */
export function theme() {
  return [chosen, storedTheme()].find((name) => THEMES.includes(name)) ?? (contrast.matches ? "day" : "grey");
}

function show() {
  document.documentElement.dataset.theme = theme();
}

/** Show and store the user's choice. */
export function chooseTheme(name) {
  chosen = name;
  try {
    window.localStorage.setItem(STORAGE_KEY, name);
  } catch {
    // storage is blocked: the selection is lost when the page closes
  }
  show();
}

contrast.addEventListener("change", show);
show(); // before the first texts, so that the page never flashes in the other theme
