"""The documents of people: sessions, users, tokens, the audit trail. Times are Unix seconds."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, Field, model_validator

from cellctl.api.models import Because, Strict
from cellctl.passwords import LONGEST
from cellctl.store.tokens import Role, Scope

Password = Field(min_length=1, max_length=LONGEST, description="of 10 characters or more where it is a new one")


class SignIn(Strict):
    """A user's name and password, or a token."""

    user: str | None = Field(None, min_length=1, max_length=64)
    password: str | None = Field(None, min_length=1, max_length=LONGEST)
    token: str | None = Field(None, min_length=1, max_length=200)

    @model_validator(mode="after")
    def one_way(self) -> Self:
        """Either, not both."""
        by_password = self.user is not None and self.password is not None
        if by_password == (self.token is not None) or (self.user is None) != (self.password is None):
            raise ValueError("give user and password, or token")
        return self


class Session(BaseModel):
    """Who is signed in. csrf: to be sent as X-CSRF-Token with everything that changes something; "" for a token sent itself"""

    name: str
    role: Role
    scopes: list[Scope]
    is_user: bool = Field(description="whether it is a user with a password, and not a token")
    csrf: str
    stop_url: str


class OwnPassword(Strict):
    """A new password in the place of the old one."""

    password: str = Password
    new_password: str = Password


class NewUser(Strict):
    """A user to be made. The name is kept in small letters."""

    name: str = Field(min_length=1, max_length=64)
    role: Role
    password: str = Password


class UserChange(Strict):
    """What is to be different about a user."""

    role: Role | None = None
    disabled: bool | None = None
    because: str = Because


class FreshPassword(Strict):
    """A password set by an admin."""

    password: str = Password
    because: str = Because


class User(BaseModel):
    """A user. password_at: when the password was set; disabled_at: from when on nobody signs in as this one"""

    name: str
    role: Role
    created_at: float
    password_at: float
    disabled_at: float | None


class Users(BaseModel):
    """All users."""

    items: list[User]


class NewToken(Strict):
    """A token to be made. scopes: what it is good for within its role; none named means all"""

    name: str = Field(min_length=1, max_length=100)
    role: Role
    scopes: list[Scope] = Field(default_factory=list, max_length=len(Scope))
    lifetime_s: float | None = Field(None, gt=0, le=10 * 365 * 86400)


class Token(BaseModel):
    """A token without its secret."""

    id: str
    name: str
    role: Role
    scopes: list[Scope]
    created_at: float
    expires_at: float | None
    revoked_at: float | None


class FreshToken(Token):
    """A token with its secret, which is shown this once."""

    secret: str


class Tokens(BaseModel):
    """All tokens."""

    items: list[Token]


class AuditItem(BaseModel):
    """One row of the trail: who did what, from where and why, and what came of it. sha256: of this row and all before it"""

    seq: int
    at: float
    who: str
    role: str
    origin: str
    verb: str
    target: str
    because: str
    outcome: str
    sha256: str


class AuditPage(BaseModel):
    """A page of the trail, newest first."""

    items: list[AuditItem]
    next: str | None = Field(None, description="cursor of the following page")


class AuditVerdict(BaseModel):
    """Whether the trail is as it was written. head: hash of the last row, to be noted elsewhere; fault: "" if all fits"""

    rows: int
    head: str
    fault: str
