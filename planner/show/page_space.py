"""The plan in space for the page: its facets packed small, and the script that turns them under the hand."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from planner.plan import Plan
from planner.show.solid import solid_of
from planner.show.space import HANGING, piece_colour

_MOST_SLABS, _CHORD = 150, 0.004  # of the page: a file that opens at once
_STEPS = 65535


def space_data(plan: Plan) -> dict[str, Any]:
    """What the script draws.

    facets : base64 of 28 bytes each: 12 uint16 (four corners in steps of the box), 3 int8 (normal, 127 = 1), 1 uint8 (piece)
    first : facets before each layer   low, size : mm, the box   colours : of the pieces
    hanging : polylines [layer, x, y, z, x, …] mm   skeleton : pairs of points, mm
    """
    solid = solid_of(plan, _MOST_SLABS, _CHORD)
    points = solid.corners.reshape(-1, 3) if len(solid.corners) else plan.bounds
    low = points.min(axis=0)
    size = float((points.max(axis=0) - low).max()) or 1.0
    packed = np.zeros(len(solid.corners), dtype=[("corners", "<u2", (4, 3)), ("normal", "i1", (3,)), ("piece", "u1")])
    packed["corners"] = np.round((solid.corners - low) / size * _STEPS)
    packed["normal"] = np.round(127.0 * solid.normals)
    packed["piece"] = solid.piece % 256
    bones = np.empty((0, 3)) if plan.skeleton is None else plan.skeleton.nodes[plan.skeleton.edges.ravel()]
    return {
        "facets": base64.b64encode(packed.tobytes()).decode(),
        "first": solid.first.tolist(),
        "low": np.round(low, 3).tolist(),
        "size": round(size, 3),
        "colours": [piece_colour(k) for k in range(max(len(plan.subcomponents), 1))],
        "hanging": [
            [number, *(np.round(np.vstack([line, line[:1]]), 2) + 0.0).ravel().tolist()]
            for number, layer in enumerate(plan.layers)
            for line in layer.overhang
        ],
        "hanging_colour": HANGING,
        "skeleton": (np.round(bones, 2) + 0.0).ravel().tolist(),
    }


SPACE_SCRIPT = """
(()=>{const d=JSON.parse(document.getElementById('space').textContent),canvas=document.querySelector('canvas');
const gl=canvas.getContext('webgl',{antialias:true,preserveDrawingBuffer:true});
if(!gl){canvas.replaceWith('This browser draws nothing in space (no WebGL).');return;}
const raw=Uint8Array.from(atob(d.facets),c=>c.charCodeAt(0)),view=new DataView(raw.buffer),n=raw.length/28;
const rgb=d.colours.map(c=>[1,3,5].map(k=>parseInt(c.slice(k,k+2),16)/255));
const faces=[],edges=[],edgeFirst=new Uint32Array(n+1);
for(let f=0;f<n;f++){const o=f*28,p=[0,1,2,3].map(k=>[0,1,2].map(a=>view.getUint16(o+6*k+2*a,true)/65535));
 const m=[24,25,26].map(k=>view.getInt8(o+k)/127),c=rgb[view.getUint8(o+27)%rgb.length];
 for(const k of [0,1,2,0,2,3])faces.push(...p[k],...m,...c);
 if(p[2].some((v,a)=>v!==p[3][a])){for(const k of [0,1])edges.push(...p[k],0,0,0,.27,.31,.34);}
 edgeFirst[f+1]=edges.length/9;}
const unit=(x,k)=>(x-d.low[k])/d.size,lines=[],lineLayer=[];
for(const [l,...q] of d.hanging)for(let k=0;k+5<q.length;k+=3){for(const j of [k,k+3])
 lines.push(unit(q[j],0),unit(q[j+1],1),unit(q[j+2],2),0,0,0,...[1,3,5].map(i=>parseInt(d.hanging_colour.slice(i,i+2),16)/255));lineLayer.push(l);}
const bones=[];for(let k=0;k<d.skeleton.length;k+=3)bones.push(unit(d.skeleton[k],0),unit(d.skeleton[k+1],1),unit(d.skeleton[k+2],2),0,0,0,.1,.1,.12);
const shader=(kind,text)=>{const s=gl.createShader(kind);gl.shaderSource(s,text);gl.compileShader(s);gl.attachShader(program,s);};
const program=gl.createProgram();
shader(gl.VERTEX_SHADER,'attribute vec3 p,n,c;uniform mat3 t;uniform vec4 v;uniform float near;varying vec3 k;void main(){vec3 q=t*(p-v.xyz);'+
 'float l=dot(n,n)>0.?.6+.4*max(dot(t*n,vec3(.3,.5,.81)),0.):1.;k=c*l;gl_Position=vec4(q.x*v.w,q.y*v.w,-q.z*.25-near,1.);}');
shader(gl.FRAGMENT_SHADER,'precision mediump float;varying vec3 k;void main(){gl_FragColor=vec4(k,1.);}');
gl.linkProgram(program);gl.useProgram(program);gl.enable(gl.DEPTH_TEST);
const at=name=>gl.getUniformLocation(program,name),load=rows=>{const b=gl.createBuffer();gl.bindBuffer(gl.ARRAY_BUFFER,b);
 gl.bufferData(gl.ARRAY_BUFFER,new Float32Array(rows),gl.STATIC_DRAW);return b;};
const buffers={faces:load(faces),edges:load(edges),lines:load(lines),bones:load(bones)};
let azimuth=-58,elevation=24,zoom=1;const top=[0,1,2].map(a=>{let m=0;for(let k=a;k<faces.length;k+=9)m=Math.max(m,faces[k]);return m/2;});
const part=(name,mode,count,near)=>{if(!count)return;gl.bindBuffer(gl.ARRAY_BUFFER,buffers[name]);
 ['p','n','c'].forEach((a,k)=>{const l=gl.getAttribLocation(program,a);gl.enableVertexAttribArray(l);
  gl.vertexAttribPointer(l,3,gl.FLOAT,false,36,12*k);});
 gl.uniform1f(at('near'),near);gl.drawArrays(mode,0,count);};
function draw(){const a=azimuth*Math.PI/180,e=elevation*Math.PI/180,w=canvas.clientWidth,h=canvas.clientHeight,dpr=devicePixelRatio||1;
 if(canvas.width!==w*dpr||canvas.height!==h*dpr){canvas.width=w*dpr;canvas.height=h*dpr;}
 const side=Math.min(canvas.width,canvas.height);gl.viewport((canvas.width-side)/2,(canvas.height-side)/2,side,side);
 gl.clearColor(1,1,1,1);gl.clear(gl.COLOR_BUFFER_BIT|gl.DEPTH_BUFFER_BIT);
 const r=[-Math.sin(a),Math.cos(a),0],o=[Math.cos(e)*Math.cos(a),Math.cos(e)*Math.sin(a),Math.sin(e)];
 const u=[-Math.sin(e)*Math.cos(a),-Math.sin(e)*Math.sin(a),Math.cos(e)];
 gl.uniformMatrix3fv(at('t'),false,[r[0],u[0],o[0],r[1],u[1],o[1],r[2],u[2],o[2]]);gl.uniform4f(at('v'),...top,.98*zoom/Math.max(Math.hypot(...top),.1));
 const built=document.getElementById('built').checked?+document.querySelector('input[type=range]').value+1:d.first.length-1,count=d.first[built];
 part('faces',gl.TRIANGLES,6*count,0);part('edges',gl.LINES,edgeFirst[count],.002);
 part('lines',gl.LINES,2*lineLayer.filter(l=>l<built).length,.003);part('bones',gl.LINES,bones.length/9,.9);}
canvas.addEventListener('pointermove',e=>{if(!e.buttons)return;azimuth-=.5*e.movementX;elevation=Math.max(-90,Math.min(90,elevation+.5*e.movementY));draw();});
canvas.addEventListener('wheel',e=>{e.preventDefault();zoom*=Math.exp(-.001*e.deltaY);draw();},{passive:false});
canvas.addEventListener('keydown',e=>{const k={ArrowLeft:[-10,0],ArrowRight:[10,0],ArrowUp:[0,10],ArrowDown:[0,-10]}[e.key];
 if(k){e.preventDefault();azimuth+=k[0];elevation=Math.max(-90,Math.min(90,elevation+k[1]));draw();}});
document.querySelector('input[type=range]').addEventListener('input',draw);document.getElementById('built').addEventListener('change',draw);
addEventListener('resize',draw);draw();})();
"""
