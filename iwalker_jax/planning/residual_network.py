"""The residual trunk shared by both iPath sizes: ResNet-18's layout at any width."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx
from jaxtyping import Array, Float

_FEW_PIXELS = 64
"""Output pixels of a whole batch up to which a matrix product beats XLA's CPU convolution, which divides its work by
pixels: with hundreds of channels on a 3 x 5 map its gradients take three times as long."""


class Conv(nnx.Module):
    """A convolution whose weights are He-initialised; NHWC."""

    def __init__(self, kernel: int, c_in: int, c_out: int, stride: int, pad: int, bias: bool, rngs: nnx.Rngs) -> None:
        scale = float(np.sqrt(2.0 / (kernel * kernel * c_in)))
        self.kernel = nnx.Param(scale * jax.random.normal(rngs.params(), (kernel, kernel, c_in, c_out)))
        self.has_bias = bias
        if bias:
            self.bias = nnx.Param(jnp.zeros(c_out))
        self.stride, self.pad = stride, pad

    def __call__(self, x: Float[Array, "batch h w c"]) -> Float[Array, "batch h2 w2 d"]:
        y = conv2d(x, self.kernel[...], self.stride, self.pad)
        return y + self.bias[...] if self.has_bias else y


class ResidualBlock(nnx.Module):
    """Two 3x3 convolutions and a shortcut; normalisation in the 1x1 shortcut alone, as published."""

    def __init__(self, c_in: int, c_out: int, stride: int, rngs: nnx.Rngs) -> None:
        self.first = Conv(3, c_in, c_out, stride, 1, False, rngs)
        self.second = Conv(3, c_out, c_out, 1, 1, False, rngs)
        # Without normalisation the residual branches would double the variance at every block.
        self.second.kernel[...] = 0.5 * self.second.kernel[...]
        self.has_shortcut = stride != 1 or c_in != c_out
        if self.has_shortcut:
            self.shortcut = Conv(1, c_in, c_out, stride, 0, False, rngs)
            self.scale = nnx.Param(jnp.ones(c_out))
            self.offset = nnx.Param(jnp.zeros(c_out))

    def __call__(self, x: Float[Array, "batch h w c"]) -> Float[Array, "batch h2 w2 d"]:
        y = self.second(jax.nn.relu(self.first(x)))
        if self.has_shortcut:
            x = self.shortcut(x)
            # Statistics over the image alone: the same at batch 1 and 16, in training and in use.
            mean = jnp.mean(x, axis=(1, 2), keepdims=True)
            variance = jnp.var(x, axis=(1, 2), keepdims=True)
            x = (x - mean) * jax.lax.rsqrt(variance + 1e-5) * self.scale[...] + self.offset[...]
        return jax.nn.relu(x + y)


class Trunk(nnx.Module):
    """ResNet-18 layout [2, 2, 2, 2]: 7x7/2 stem, 3x3/2 max-pool, four stages that double the channels."""

    def __init__(self, c_in: int, width: int, rngs: nnx.Rngs) -> None:
        self.stem = Conv(7, c_in, width, 2, 3, False, rngs)
        blocks = []
        channels = width
        for stage in range(4):
            wide = width * 2**stage
            blocks += [
                ResidualBlock(channels, wide, 2 if stage else 1, rngs),
                ResidualBlock(wide, wide, 1, rngs),
            ]
            channels = wide
        self.blocks = nnx.List(blocks)

    def __call__(self, x: Float[Array, "batch h w c"]) -> Float[Array, "batch h2 w2 d"]:
        x = max_pool_3x3(jax.nn.relu(self.stem(x)))
        for block in self.blocks:
            x = block(x)
        return x


def trunk_size(pixels: int) -> int:
    """Side of the trunk's last map for an image side: five strided layers, each rounding up."""
    for _ in range(5):
        pixels = (pixels + 1) // 2
    return pixels


def conv2d(
    x: Float[Array, "batch h w c"], kernel: Float[Array, "kh kw c d"], stride: int, pad: int
) -> Float[Array, "batch h2 w2 d"]:
    """Cross-correlation of NHWC images with an HWIO kernel, zero padding `pad` on every side."""
    kh, kw, _, channels = kernel.shape
    batch = x.shape[0]
    height, width = (x.shape[1] + 2 * pad - kh) // stride + 1, (x.shape[2] + 2 * pad - kw) // stride + 1
    # A kernel larger than its map sends XLA's CPU convolution to plain loops, a hundred times slower.
    fits = kh <= x.shape[1] and kw <= x.shape[2]
    if fits and batch * height * width > _FEW_PIXELS:
        return jax.lax.conv_general_dilated(
            x, kernel, (stride, stride), ((pad, pad), (pad, pad)), dimension_numbers=("NHWC", "HWIO", "NHWC")
        )
    padded = jnp.pad(x, ((0, 0), (pad, pad), (pad, pad), (0, 0)))
    end = stride * (height - 1) + 1, stride * (width - 1) + 1
    taps = [padded[:, i : i + end[0] : stride, j : j + end[1] : stride] for i in range(kh) for j in range(kw)]
    columns = jnp.concatenate(taps, axis=-1).reshape(batch * height * width, -1)
    return (columns @ kernel.reshape(-1, channels)).reshape(batch, height, width, channels)


def at_least_two_rows(x: Float[Array, "batch n"]) -> Float[Array, "rows n"]:
    """A single row gets a row of zeros below it; more rows stay as they are.

    XLA writes the weight gradient of a one-row product transposed and copies it back, several times the product's time.
    """
    return jnp.pad(x, ((0, max(0, 2 - x.shape[0])), (0, 0)))


def max_pool_3x3(x: Float[Array, "batch h w c"]) -> Float[Array, "batch h2 w2 c"]:
    """3x3 maximum with stride 2 and padding 1, separable: two passes of three strided slices.

    `lax.reduce_window`'s gradient (select-and-scatter) is several times slower on CPUs than these slices.
    """
    for axis in (1, 2):
        widths = [(0, 0)] * 4
        size = x.shape[axis]
        out = (size + 1) // 2
        widths[axis] = (1, max(2 * out - size, 0))
        padded = jnp.pad(x, widths, constant_values=-jnp.inf)
        parts = [jax.lax.slice_in_dim(padded, k, k + 2 * out - 1, 2, axis) for k in range(3)]
        x = jnp.maximum(jnp.maximum(parts[0], parts[1]), parts[2])
    return x


def halve(x: Float[Array, "batch h w c"]) -> Float[Array, "batch h2 w2 c"]:
    """Mean of every 2 x 2 block of pixels (an odd last row or column is dropped)."""
    batch, height, width, channels = x.shape
    x = x[:, : height // 2 * 2, : width // 2 * 2]
    return x.reshape(batch, height // 2, 2, width // 2, 2, channels).mean(axis=(2, 4))
