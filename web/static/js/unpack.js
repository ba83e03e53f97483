// Starts a page without a server: unpacks the scripts that it contains and runs the one named by
// this script's tag. A classic script, because browsers load no modules from a folder.
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
