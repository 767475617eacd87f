// The page "hand".

export function Hand() {
  return <section class="hand" />;
}
