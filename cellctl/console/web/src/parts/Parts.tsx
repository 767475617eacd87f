// The page "parts".

export function Parts() {
  return <section class="parts" />;
}
