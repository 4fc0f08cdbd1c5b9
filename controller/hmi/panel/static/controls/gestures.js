// Gestures of a touch screen: a long touch opens no menu. The style sheet prevents zooming, and leaving the page.

document.addEventListener("contextmenu", (event) => ["touch", "pen"].includes(event.pointerType) && event.preventDefault());
