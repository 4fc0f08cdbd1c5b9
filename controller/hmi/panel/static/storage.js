// Choices of the user that are kept in the browser; if its storage is blocked, they are lost when the page closes.

/** Return the value stored under a key, or null. */
export function stored(key) {
  try {
    return window.localStorage.getItem(key);
  } catch {
    return null;
  }
}

/** Store a value under a key. */
export function store(key, value) {
  try {
    window.localStorage.setItem(key, value);
  } catch {
    // the page keeps the choice itself
  }
}
