// How metal looks: a sphere that is lit once (a matcap) gives light and gloss at the price of one texture.
import { CanvasTexture, MeshMatcapMaterial, SRGBColorSpace } from "three";

const SIZE = 128;

function lit(): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = SIZE;
  const pen = canvas.getContext("2d");
  if (pen) {
    const half = SIZE / 2;
    const body = pen.createRadialGradient(half * 0.72, half * 0.55, half * 0.05, half, half * 1.05, half * 1.25);
    body.addColorStop(0, "#ffffff");
    body.addColorStop(0.22, "#dfe3e7");
    body.addColorStop(0.55, "#98a1aa");
    body.addColorStop(0.82, "#525b64");
    body.addColorStop(1, "#343b43");
    pen.fillStyle = body;
    pen.fillRect(0, 0, SIZE, SIZE);
    const rim = pen.createRadialGradient(half * 1.5, half * 1.55, half * 0.02, half * 1.5, half * 1.55, half * 0.55);
    rim.addColorStop(0, "rgba(150,180,210,0.55)");
    rim.addColorStop(1, "rgba(150,180,210,0)");
    pen.fillStyle = rim;
    pen.fillRect(0, 0, SIZE, SIZE);
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

let shared: CanvasTexture | null = null;

/** A metal in one colour or, with colours at its corners, in theirs. */
export function metal(options: { colour?: string; byCorner?: boolean } = {}): MeshMatcapMaterial {
  shared ??= lit();
  return new MeshMatcapMaterial({ matcap: shared, color: options.colour ?? "#ffffff", vertexColors: options.byCorner ?? false });
}
