// For a page that shows demos in frames: each frame is as high as the demo in it says, so that nothing is scrolled within.
window.addEventListener("message", (event) => {
  for (const frame of document.querySelectorAll("iframe")) {
    const height = event.data && event.data.demoHeight;
    if (frame.contentWindow === event.source && height > 0) frame.style.height = `${Math.min(20000, Math.ceil(height) + 2)}px`;
  }
});
// What a demo said before it was laid out, or before this page was whole, is asked for again.
window.addEventListener("load", () => {
  for (const frame of document.querySelectorAll("iframe")) frame.contentWindow.postMessage({ askHeight: true }, "*");
});
