// Starts a page that has no server: unpacks the scripts that it holds, and runs the one that the tag of
// this script names. No module, for browsers load none from a folder.
(async (entry) => {
  const { imports } = window.foldbackScripts;
  const bytes = Uint8Array.from(atob(imports), (character) => character.charCodeAt(0));
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const map = document.createElement("script");
  map.type = "importmap";
  map.textContent = await new Response(unpacked).text();
  document.head.append(map);
  import(entry);
})(document.currentScript?.dataset.entry ?? "");
