"""What of numba this project uses, typed so that a compiled kernel keeps the signature it is written with."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])

@overload
def njit(function: _Kernel, /) -> _Kernel: ...
@overload
def njit(
    signature: Any = ...,
    /,
    *,
    cache: bool = ...,
    parallel: bool = ...,
    fastmath: bool | set[str] = ...,
    nogil: bool = ...,
    inline: str = ...,
    boundscheck: bool | None = ...,
    error_model: str = ...,
    locals: dict[str, Any] = ...,
) -> Callable[[_Kernel], _Kernel]: ...

prange: type[range]

def set_num_threads(count: int, /) -> None: ...
def get_num_threads() -> int: ...
