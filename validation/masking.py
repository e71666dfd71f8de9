"""Height-correlated masking and shadowing for Mitsuba's rough conductor, which uses the separable form.

Heitz 2014, "Understanding the masking-shadowing function in microfacet-based BRDFs", equation 99: G2 = 1 / (1 + L(wi) + L(wo))
with L = 1 / G1 - 1, instead of Mitsuba's G1(wi) G1(wo).
"""

import drjit as dr
import mitsuba as mi


class HeightCorrelated(mi.BSDF):
    """The nested GGX `roughconductor`, times the ratio of the height-correlated to the separable form."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.alpha, self.nested = props["alpha"], props["nested"]
        self.m_components = [self.nested.flags(i) for i in range(self.nested.component_count())]
        self.m_flags = self.nested.flags()

    def ratio(self, wi, wo):
        def g1(w):
            tan2 = (dr.square(w.x) + dr.square(w.y)) / dr.square(w.z)
            return 2 / (1 + dr.sqrt(1 + self.alpha**2 * tan2))

        a, b = g1(wi), g1(wo)
        return mi.Spectrum(dr.select((wi.z > 0) & (wo.z > 0), 1 / (a + b - a * b), 0))

    def sample(self, ctx, si, sample1, sample2, active=True):
        sample, weight = self.nested.sample(ctx, si, sample1, sample2, active)
        return sample, weight * self.ratio(si.wi, sample.wo)

    def eval(self, ctx, si, wo, active=True):
        return self.nested.eval(ctx, si, wo, active) * self.ratio(si.wi, wo)

    def pdf(self, ctx, si, wo, active=True):
        return self.nested.pdf(ctx, si, wo, active)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return f"HeightCorrelated[{self.nested}]"


def register():
    mi.register_bsdf("height_correlated", HeightCorrelated)
