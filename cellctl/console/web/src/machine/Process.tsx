// Laser, powder and gas: what is set and what is read back.
import type { Snapshot } from "../api/types";
import { snapshot } from "../state/cell";
import { words } from "../words/en";
import { fixed } from "../words/format";

const say = words.machine;

interface Row {
  name: string;
  set: number;
  read: number;
  decimals: number;
  unit: string;
}

function rows({ laser, feeder }: Snapshot): Row[] {
  return [
    { name: say.laser, set: laser.power_setpoint_w, read: laser.power_readback_w, decimals: 0, unit: "W" },
    { name: say.powder, set: feeder.rate_setpoint_g_min, read: feeder.rate_readback_g_min, decimals: 1, unit: "g/min" },
    { name: say.carrier, set: feeder.carrier_gas_setpoint_l_min, read: feeder.carrier_gas_readback_l_min, decimals: 1, unit: "L/min" },
    { name: say.shield, set: feeder.shield_gas_setpoint_l_min, read: feeder.shield_gas_readback_l_min, decimals: 1, unit: "L/min" },
  ];
}

export function Process() {
  const now = snapshot.value;
  return (
    <section class="panel process">
      <div class="panel-head">
        <h2>{say.process}</h2>
        {now && <Emission laser={now.laser} />}
      </div>
      <table>
        <thead>
          <tr>
            <th />
            <th>{say.setpoint}</th>
            <th>{say.readback}</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {now &&
            rows(now).map((row) => (
              <tr key={row.name}>
                <th scope="row">{row.name}</th>
                <td class="number">{fixed(row.set, row.decimals)}</td>
                <td class="number strong">{fixed(row.read, row.decimals)}</td>
                <td class="unit">{row.unit}</td>
              </tr>
            ))}
        </tbody>
      </table>
      {now && <Hopper fraction={now.feeder.hopper_fraction} />}
      {now && <Faults texts={[...now.laser.faults, ...now.laser.interlocks, ...now.feeder.faults]} />}
    </section>
  );
}

function Emission({ laser }: { laser: Snapshot["laser"] }) {
  return (
    <span class="emission">
      <span class="muted">{say.permits(laser.enabled, laser.permitted)}</span>
      <b class={laser.emitting ? "badge laser-on" : "badge"}>{laser.emitting ? say.emitting : say.dark}</b>
    </span>
  );
}

function Hopper({ fraction }: { fraction: number }) {
  return (
    <div class="hopper">
      <span>{say.hopper}</span>
      <meter min={0} max={1} low={0.15} value={fraction} aria-label={say.hopper} />
      <b>{fixed(100 * fraction, 0)} %</b>
    </div>
  );
}

function Faults({ texts }: { texts: string[] }) {
  if (texts.length === 0) return null;
  return <p class="device-faults">{texts.join("; ")}</p>;
}
